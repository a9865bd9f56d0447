"""Commands with a subcommand for each track, built of what the track says of itself."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Sequence
from inspect import Parameter, Signature
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer.core import TyperGroup

from airzoo_bench.cli.common import examples
from airzoo_bench.core.registry import TRACKS

if TYPE_CHECKING:
    from airzoo_bench.evaluation.given import AnyTrack

__all__ = ["TrackGroup", "bounded", "parameter", "with_parameters"]


class TrackGroup(TyperGroup):
    """A group whose subcommands are the tracks, made when they are asked for.

    Tracks load NumPy, which the help of all commands must not wait for.
    """

    @abstractmethod
    def command_of(self, track: AnyTrack) -> tuple[Callable[..., None], str]:
        """Return the function of a track's subcommand, and its example."""

    def list_commands(self, ctx: Any) -> list[str]:
        """Return the names of the tracks."""
        return TRACKS.names()

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """Find the subcommand that is meant, or name what may be."""
        self.commands = dict.fromkeys(self.list_commands(ctx))  # type: ignore[assignment]
        return super().resolve_command(ctx, args)

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """Return a track's subcommand."""
        if cmd_name not in TRACKS.names():
            return None
        function, example = self.command_of(TRACKS.get(cmd_name))
        app = typer.Typer(add_completion=False)
        app.command(name=cmd_name, epilog=examples(example))(function)
        return typer.main.get_command(app)


def parameter(name: str, kind: Any, default: Any = Parameter.empty) -> Parameter:
    """Return a parameter of a command, required where it has no default."""
    return Parameter(name, Parameter.KEYWORD_ONLY, default=default, annotation=kind)


def bounded(
    name: str, kind: type[Any], help_text: str, least: float | None, most: float | None
) -> Any:
    """Return the type of an option, as a number within bounds or as a flag."""
    if kind is bool:
        return Annotated[bool, typer.Option(f"--{name}/--no-{name}", help=help_text)]
    return Annotated[kind, typer.Option(f"--{name}", min=least, max=most, help=help_text)]


def with_parameters(
    function: Callable[..., None], parameters: Sequence[Parameter], summary: str
) -> Callable[..., None]:
    """Return a function of keywords as one that says which they are."""

    def command(**values: Any) -> None:
        function(**values)

    command.__doc__ = summary
    command.__annotations__ = {one.name: one.annotation for one in parameters}
    command.__signature__ = Signature(list(parameters))  # type: ignore[attr-defined]
    return command
