"""Holds a table that code has made against its declaration."""

import pyarrow as pa

from kb.core.errors import SchemaMismatch
from kb.schema.tables import Table, table


def conform(declared: Table | str, rows: pa.Table, *, released: bool = False) -> pa.Table:
    """`rows` with the declared columns, order and types, and the declaration's metadata.

    Casts only where no value changes. Raises SchemaMismatch that lists every undeclared column,
    every missing one, every value that does not fit and every null where none is allowed.
    """
    declared = table(declared) if isinstance(declared, str) else declared
    schema = declared.arrow(released)
    known, given = set(schema.names), set(rows.column_names)
    problems = [
        f"column {name!r} is not declared" for name in rows.column_names if name not in known
    ]
    problems += [f"column {name!r} is missing" for name in schema.names if name not in given]
    if len(given) < rows.num_columns:
        problems.append("a column is there twice")
    columns = []
    for field in schema:
        if field.name not in given or problems:
            continue
        column = rows.column(field.name)
        if column.type != field.type:
            try:
                column = column.cast(field.type)
            except (pa.ArrowInvalid, pa.ArrowNotImplementedError) as error:
                first = str(error).splitlines()[0]
                problems.append(
                    f"column {field.name!r} is {column.type}, not {field.type}: {first}"
                )
                continue
        if not field.nullable and column.null_count:
            problems.append(
                f"column {field.name!r} has {column.null_count} nulls and may have none"
            )
        columns.append(column)
    if problems:
        raise SchemaMismatch(
            f"{declared.name}: " + "; ".join(problems),
            hint=f"see schemas/tables/{declared.name}.toml",
        )
    return pa.Table.from_arrays(columns, schema=schema)
