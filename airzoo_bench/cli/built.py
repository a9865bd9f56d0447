"""Commands whose subcommands are built of what a registry holds, such as tracks."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Mapping, Sequence
from inspect import Parameter, Signature
from pathlib import Path
from typing import Annotated, Any, ClassVar

import typer
from typer.core import TyperGroup

from airzoo_bench.cli.common import examples, in_panels
from airzoo_bench.core.errors import UsageError
from airzoo_bench.core.registry import Registry

__all__ = ["BuiltGroup", "bounded", "parameter", "with_parameters"]


class BuiltGroup(TyperGroup):
    """A group with a subcommand for each thing of a registry, made when it is asked for.

    What is registered loads NumPy, which the help of all commands must not wait for.
    """

    registry: Registry
    panels: ClassVar[Mapping[str, Sequence[str]]] = {}

    @abstractmethod
    def command_of(self, thing: Any) -> tuple[Callable[..., None], str]:
        """Return the function of a thing's subcommand, and its example."""

    def list_commands(self, ctx: Any) -> list[str]:
        """Return the names of what is registered."""
        return self.registry.names()

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """Find the subcommand that is meant, or name what may be."""
        names = self.list_commands(ctx)
        if args and args[0] not in names and Path(args[0]).exists():
            raise UsageError(
                f"{args[0]} stands where the name of a command does",
                expected=" or ".join(names),
                fix=f"{ctx.command_path} {names[0]} {args[0]}",
            )
        self.commands = dict.fromkeys(names)  # type: ignore[assignment]
        return super().resolve_command(ctx, args)

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """Return a subcommand."""
        if cmd_name not in self.list_commands(ctx):
            return None
        function, example = self.command_of(self.registry.get(cmd_name))
        app = typer.Typer(add_completion=False)
        grouped = in_panels(self.panels)
        app.command(name=cmd_name, cls=grouped, epilog=examples(example))(function)
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
