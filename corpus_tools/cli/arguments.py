"""Arguments that several commands share."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated

import typer

AsJson = Annotated[bool, typer.Option("--json", help="Print JSON, for programs.")]


def one_of(value: str, known: Sequence[str], option: str) -> str:
    """The value, if it is known.

    Raises
    ------
    typer.BadParameter
        If it is not: the call is wrong.
    """
    if value not in known:
        raise typer.BadParameter(f"'{value}' is not one of {', '.join(known)}", param_hint=option)
    return value
