"""Commands with a subcommand for each entry of a registry, such as tracks."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import MISSING, fields
from inspect import Parameter, Signature
from typing import Annotated, Any, ClassVar, get_args, get_origin, get_type_hints

import typer

from airzoo_bench.cli.common import EngineOption, JobsOption, LightGroup, examples, in_panels
from airzoo_bench.core.registry import Option, Registry
from airzoo_bench.engines.engine import LOCAL

Command = Callable[..., None]


class BuiltGroup(LightGroup):
    """A group with a subcommand for each entry of a registry, made when it is asked for.

    An entry may be another package's, whose import the help of all commands must not wait for.
    """

    registry: Registry
    panels: ClassVar[Mapping[str, Sequence[str]]] = {}
    own_panel = "Options"

    @abstractmethod
    def command_of(self, thing: Any) -> tuple[Command, *tuple[str, ...]]:
        """Return the function of an entry's subcommand, and its examples."""

    def summary_of(self, name: str) -> str:
        """Return what the list of subcommands says of an entry."""
        return str(self.registry.get(name).summary)

    def list_commands(self, ctx: Any) -> list[str]:
        """Return the registered names."""
        return self.registry.names()

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """List the subcommands, whose options are not made for it."""
        with formatter.section("Commands"):
            summaries = {name: self.summary_of(name) for name in self.list_commands(ctx)}
            formatter.write_dl([(n, text.partition("\n\n")[0]) for n, text in summaries.items()])

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """Return a subcommand."""
        if cmd_name not in self.registry:  # which does not look at all packages, as its names do
            return None
        function, *calls = self.command_of(self.registry.get(cmd_name))
        app = typer.Typer(add_completion=False)
        grouped = in_panels(self.panels, self.own_panel)
        app.command(name=cmd_name, cls=grouped, epilog=examples(*calls))(function)
        return typer.main.get_command(app)


def built_app(group: type[BuiltGroup], summary: str) -> typer.Typer:
    """Return the command whose subcommands a group makes."""
    app = typer.Typer(cls=group, help=summary, no_args_is_help=True)
    app.callback()(lambda: None)
    return app


def parameter(name: str, kind: Any, default: Any = Parameter.empty) -> Parameter:
    """Return a parameter of a command, required where it has no default."""
    return Parameter(name, Parameter.KEYWORD_ONLY, default=default, annotation=kind)


def engine_parameters(jobs: int) -> list[Parameter]:
    """Return the options of a command whose work may be done elsewhere."""
    return [parameter("jobs", JobsOption, jobs), parameter("engine", EngineOption, LOCAL)]


def option_parameters(
    settings: type[Any], texts: Mapping[str, Option] | None = None
) -> list[Parameter]:
    """Return a parameter for each field of a settings dataclass that is an option.

    Its type carries an `Option` or one of typer's, or `texts` has the option of its name.
    """
    hints = get_type_hints(settings, include_extras=True)
    found = []
    for field in fields(settings):
        kind, one = hints[field.name], (texts or {}).get(field.name.replace("_", "-"))
        default = Parameter.empty if field.default is MISSING else field.default
        if get_origin(kind) is Annotated and isinstance(get_args(kind)[1], Option):
            kind, one = get_args(kind)[:2]
        if one is not None:
            found.append(parameter(field.name, _typed(kind, one, default), default))
        elif get_origin(kind) is Annotated:
            found.append(parameter(field.name, kind, default))
    return found


def _typed(kind: Any, one: Option, default: Any) -> Any:
    """Return the type of an option, as a number within bounds or as a flag."""
    if kind is bool:
        flag = f"--{one.name}/--no-{one.name}" if default else f"--{one.name}"
        return Annotated[bool, typer.Option(flag, help=one.help)]
    option = typer.Option(f"--{one.name}", min=one.least, max=one.most, help=one.help)
    return Annotated[kind, option]


def with_parameters(function: Command, parameters: Sequence[Parameter], summary: str) -> Command:
    """Return a function of keywords as one that says which they are."""

    def command(**values: Any) -> None:
        function(**values)

    command.__doc__ = summary
    command.__annotations__ = {one.name: one.annotation for one in parameters}
    command.__signature__ = Signature(list(parameters))  # type: ignore[attr-defined]
    return command
