"""Fill in the entries that benchmark.toml of a folder made by hand lacks."""

from __future__ import annotations

from pathlib import Path

from airzoo_bench.benchmark.folder import (
    Benchmark,
    BenchmarkFile,
    SceneFile,
    verify,
    write_benchmark_file,
)
from airzoo_bench.core.errors import BenchmarkError, first_of
from airzoo_bench.core.files import sha256_of
from airzoo_bench.core.validation import read_toml, validated
from airzoo_bench.evaluation.evaluate import read_truth
from airzoo_bench.geometry.raster_files import raster_sha256
from airzoo_bench.protocol.model import Protocol, load_protocol


def complete_manifest(folder: Path, *, replace: bool = False) -> list[str]:
    """Write what benchmark.toml lacks: settings of the truth, checksums of files and of data."""
    path = folder / "benchmark.toml"
    values = read_toml(path, BenchmarkError, "benchmark file")
    protocols = [load_protocol(one) for one in sorted((folder / "protocols").glob("*.toml"))]
    if not protocols:
        fix = "copy one of `airzoo-bench protocols NAME`, and set `benchmark` and scenes"
        raise BenchmarkError("has no protocol", where=folder / "protocols", fix=fix)
    name = protocols[0].benchmark
    complete = {"schema": 1, "name": name, "version": 1, "title": name, "checksums": {}}
    complete["tracks"] = {one.track: one.truth_settings() for one in protocols}
    said = [key for key in complete if key not in values]
    file = validated(complete | values, BenchmarkFile, BenchmarkError, path, "benchmark file")
    before, file = file.by_hand, file.model_copy(update={"by_hand": True})
    if file.checksums and not replace:
        with Benchmark(folder, file).fixes():
            verify(folder, file)
    scenes = tuple(_with_checksums(folder, scene, said, replace) for scene in file.scenes)
    file = file.model_copy(update={"scenes": scenes})
    benchmark = Benchmark(folder, file)
    for protocol in protocols:
        benchmark.check_fits(protocol)
        for scene in protocol.scenes:
            _check_truth(benchmark, scene.id, protocol)
    if not said and not replace:
        file = file.model_copy(update={"by_hand": before})
    write_benchmark_file(folder, file)
    return [*said, "checksums of all files below scenes/"]


def _check_truth(benchmark: Benchmark, scene: str, protocol: Protocol) -> None:
    """Read the truth of a scene as `eval` does, and refuse ids that predictions could not name."""
    home = benchmark.scene_folder(scene)
    with benchmark.fixes():
        truth = read_truth(benchmark, protocol, scene)
    for name in ("queries", "tiles"):
        table = getattr(truth, name, None)
        ids = [] if table is None else table["id"].tolist()
        without = [one for one in ids if not one.startswith(f"{scene}/")]
        if without:
            what = f"ids of {name} lack their scene: {first_of(without, len(ids))}"
            expected = f"ids that begin with the scene, such as {scene}/{without[0]}"
            raise BenchmarkError(what, where=home, expected=expected)


def _with_checksums(folder: Path, scene: SceneFile, said: list[str], replace: bool) -> SceneFile:
    found = {}
    for part, sha256 in (("dsm", raster_sha256), ("cloud", sha256_of)):
        place, before = getattr(scene, part), getattr(scene, f"{part}_sha256")
        if place is None or not (folder / place).is_file():
            continue
        now = found[f"{part}_sha256"] = sha256(folder / place)
        if before not in (None, now) and not replace:
            what = f"the {part} of scene {scene.id} was changed since its checksums were written"
            fix = "put it back; or, if the truth is that of the changed file, add --force"
            raise BenchmarkError(what, where=folder / place, fix=fix)
        said += [f"{part}_sha256 of scene {scene.id}"] * (before is None)
    return scene.model_copy(update=found)
