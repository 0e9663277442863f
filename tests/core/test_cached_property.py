"""A property is computed once, also when two threads ask at the same time."""

import contextlib
import threading
from concurrent.futures import ThreadPoolExecutor

from kb.core.cached_property import cached_property

BOTH_IN_S = 0.5  # in which a second thread would begin as well, if nothing held it back


class World:
    def __init__(self) -> None:
        self.made = 0
        self.both = threading.Barrier(2)

    @cached_property
    def posts(self) -> list[int]:
        self.made += 1
        with contextlib.suppress(threading.BrokenBarrierError):
            self.both.wait(BOTH_IN_S)
        return [self.made]

    @cached_property
    def first(self) -> int:
        return self.posts[0]


def test_two_threads_have_one_value() -> None:
    world = World()
    with ThreadPoolExecutor(2) as pool:
        one, other = pool.map(lambda _: world.posts, range(2))
    assert one is other
    assert world.made == 1


def test_one_may_need_another_and_each_instance_has_its_own() -> None:
    worlds = World(), World()
    assert [world.first for world in worlds] == [1, 1]
    assert worlds[0].posts is not worlds[1].posts
    assert isinstance(World.posts, cached_property)
