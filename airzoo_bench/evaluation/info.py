"""What the command line says of a track before it imports any of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

from airzoo_bench.core.registry import Option

__all__ = ["DOUBLED", "Baseline", "EvalOption", "TrackInfo"]

DOUBLED = Option("double", "Look for the finest features too, for four times the time.")


@dataclass(frozen=True)
class EvalOption:
    """An option of ``airzoo-bench eval`` that one track has.

    Attributes
    ----------
    name : str
        Without its hyphens.
    act : str
        ``module:function`` to call: it takes the `evaluate.Evaluation`, the option's value, the
        output folder or None, and `Run`, and yields lines to print.
    default : bool or int
        An int makes it an option with a number from 1 to `most`.
    needs_out : bool
        Whether it writes files, into a folder of its name, so that ``--out`` must be given.
    files : str
        A regular expression of their names: a folder with other files is not replaced.
    """

    name: str
    help: str
    act: str
    default: bool | int = False
    most: int = 1
    needs_out: bool = True
    files: str = ".*"


@dataclass(frozen=True)
class Baseline:
    """A track's baseline: a plain method that needs no weights.

    Attributes
    ----------
    method : str
        Its name in tables.
    summary : str
        What it does, in one sentence, for the help.
    settings, demo : dataclass
        Its default settings, and those of the demonstration; fields may be annotated with an
        `Option`.
    out : str
        Default name of the predictions.
    out_help, example : str
        For the help; the example names a protocol and where to write.
    predict : str
        ``module:function`` to call: it takes protocol, benchmark, settings, the path to write to,
        `Run`, and a callable for notes on each scene.
    """

    method: str
    summary: str
    settings: Any
    demo: Any
    out: str
    out_help: str
    example: str
    predict: str


@dataclass(frozen=True)
class TrackInfo:
    """The row of a track in the registry.

    Attributes
    ----------
    name : str
        As in protocol files, commands and results.
    track : str
        ``module:NAME`` of its `Track`, which is imported when something is scored.
    summary : str
        What is scored, in one sentence, for the help.
    argument, example : str
        For the help: what predictions are; predictions and further options.
    unit : {"query", "scene"}
        What a record is of; of scenes, intervals and tests resample these.
    suffixes : tuple of str
        Endings of files that can be predictions.
    kinds : str
        What predictions come in, for messages.
    folders : bool
        Whether predictions can be a folder, as templates then are.
    fields : tuple of str
        Fields of an ``.npz`` that no other track has.
    jobs : int
        Threads that ``eval`` takes by default.
    takes_image_size : bool
        Whether a reader of the track reads `reader.Reading.image_size`.
    options : tuple of EvalOption
    files : mapping of str to str
        What a run writes beside ``result.json`` and ``records.csv``: by its name the
        ``module:function`` to call with the `evaluate.Evaluation` and the path.
    baseline : Baseline or None
    templates : tuple of str
        What templates can hold, the default first; empty where there is no choice.
    """

    name: str
    track: str
    summary: str
    argument: str = "A prediction file."
    example: str = "preds.npz --out results/mymethod"
    unit: Literal["query", "scene"] = "query"
    suffixes: tuple[str, ...] = (".npz",)
    kinds: str = ".npz"
    folders: bool = False
    fields: tuple[str, ...] = ()
    jobs: int = 2
    takes_image_size: bool = False
    options: tuple[EvalOption, ...] = ()
    files: Mapping[str, str] = field(default_factory=dict)
    baseline: Baseline | None = None
    templates: tuple[str, ...] = ()
