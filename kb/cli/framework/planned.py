"""Options beside `--plan`: one that the plan takes no account of is refused, not ignored."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from kb.cli.framework.options import RUNNING, Options

if TYPE_CHECKING:
    from kb.cli.framework.options import Options


def check(
    function: Callable[..., Any],
    options: Options,
    own: Mapping[str, Any],
    counted: Sequence[str],
) -> None:
    """Raise SettingError where `own` asks for a plan and an option was given that it leaves out.

    `own` are the values of the command's own options, whose defaults `function` knows; `counted`
    names the options, own and shared ones, that change the plan.
    """
    if not own.get("plan"):
        return
    given = [name for name in RUNNING if getattr(options, name) != getattr(Options, name)]
    declared = inspect.signature(function).parameters
    given += [name for name in own if name != "plan" and own[name] != declared[name].default]
    idle = [f"--{name.replace('_', '-')}" for name in given if name not in counted]
    if not idle:
        return
    from kb.core.errors import SettingError

    raise SettingError(
        f"{' and '.join(idle)} {'has' if len(idle) == 1 else 'have'} no effect on --plan",
        hint="leave out either: the plan is of all that is left",
    )
