"""Tests of `kb.search.query`."""

from kb.search.query import Term, question


def test_what_is_typed_becomes() -> None:
    assert question("how-to 'ride'").terms == (Term("how to"), Term("ride"))
    assert question("how-to 'ride'").run == ("how", "to", "ride")
    assert question("wolf -dog").run == question("wolf dog*").run == ()
    assert question("wolf -dog wolf").run == ("wolf", "wolf")
    asked = question('wolf "bed rock" craft* +iron -dog -"a b"')
    craft = Term("craft", prefix=True)
    assert asked.terms == (Term("wolf"), Term("bed rock"), craft, Term("iron"))
    assert asked.needed == (Term("bed rock"), Term("iron"))
    assert asked.barred == (Term("dog"), Term("a b"))
    asked = question("How do I tame the wolf?")
    assert asked.terms == (Term("tame"), Term("wolf"))
    assert len(question("how to").terms) == 2
    assert len(question('+how "to the" wolf').terms) == 3
    assert question("x" + " y z" * 100).terms == question("x y z").terms
    assert len(question(" ".join(map(str, range(100)))).terms) == 32
