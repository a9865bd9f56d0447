"""The sealed edition: what a key hides, and what who knows no key can find."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from airzoo_bench.core.errors import UsageError
from airzoo_bench.datasets.mini.dataset import (
    MiniOptions,
    mini_photos,
    mini_protocols,
)
from airzoo_bench.datasets.mini.frames import FrameList
from airzoo_bench.datasets.mini.noise import (
    GOLDEN,
    Dice,
    derived,
    hash64,
    hash_of,
    keyed,
    noisy_priors,
    seed_of,
    words,
)
from airzoo_bench.datasets.mini.world import REGIONS, world_folder

_MASK = (1 << 64) - 1
KEY = bytes.fromhex("9f86d081884c7d659a2feaa0c55ad015")
SEED = keyed(KEY)

MADE: dict[str, Callable[[int], object]] = {
    "choices": lambda seed: [Dice(seed, 3).bits() for _ in range(2)],
    "hashes": lambda seed: hash_of(seed, 3, 4).tolist(),
    "noise of textures": lambda seed: hash_of(seed, 77, np.arange(4)).tolist(),
    "noise of pixels": lambda seed: hash64(np.arange(4, dtype=np.uint64), seed).tolist(),
    "noise of a texture": lambda seed: hash64(np.arange(4, dtype=np.uint64), seed + 9).tolist(),
    "flights": lambda seed: words(seed, 4).tolist(),
    "seeds of photos": lambda seed: seed_of(derived(seed, "noise"), "a"),
}


@pytest.mark.parametrize("made", MADE.values(), ids=MADE)
def test_every_bit_of_the_key_counts(made: Callable[[int], object]) -> None:
    """A seed keeps 64 bits; of a key, changing any one of 128 changes all."""
    others = [made(SEED ^ (1 << bit)) for bit in range(128)]
    assert len({str(one) for one in (made(SEED), *others)}) == 129


@pytest.mark.parametrize("made", MADE.values(), ids=MADE)
def test_no_part_of_the_key_is_the_seed(made: Callable[[int], object]) -> None:
    found = str(made(SEED))
    parts = [SEED & _MASK, SEED >> 64, (SEED >> 64) & _MASK, *range(2000)]
    parts += [int.from_bytes(KEY[:8], "little"), int.from_bytes(KEY[8:], "little")]
    assert found not in {str(made(part)) for part in parts}


def turned_around(value: int) -> int:
    """Undo the finaliser of SplitMix64."""
    for shift, factor in ((31, 0x94D049BB133111EB), (27, 0xBF58476D1CE4E5B9)):
        value ^= (value >> shift) ^ (value >> 2 * shift)
        value = value * pow(factor, -1, 1 << 64) & _MASK
    return value ^ (value >> 30) ^ (value >> 60)


def test_a_draw_that_is_seen_tells_the_others_of_a_seed_only() -> None:
    """The attack: from one draw back to the start, and on to the next."""

    def foretold(dice: Dice) -> bool:
        first, second = dice.bits(), dice.bits()
        start = (turned_around(first) - int(GOLDEN)) & _MASK ^ 1
        return int(hash_of(start, 2)[0]) == second

    assert foretold(Dice(1234, 3))
    assert not foretold(Dice(SEED, 3))


def test_purposes_are_apart_and_lead_nowhere_back() -> None:
    seeds = [derived(SEED, purpose) for purpose in ("worlds", "noise", "priors of city")]
    assert len({SEED, *seeds}) == 4
    assert all(seed >> 128 == 1 for seed in seeds)
    assert derived(7, "worlds") == 7


@cache
def photos(seed: int) -> FrameList:
    dsm = np.full((1200, 1200), 20.0, np.float32)
    return mini_photos(REGIONS["city"], dsm, seed)


def test_names_tell_no_flight_and_no_order() -> None:
    found = photos(SEED)
    names, flights = found.names, found.sequence
    assert all(len(name) == 16 and int(name, 16) >= 0 for name in names)
    assert not {"survey", "roll"} & set(names)
    rows = np.array(sorted(range(len(names)), key=lambda row: names[row]))
    assert abs(np.corrcoef(rows, np.arange(len(rows)))[0, 1]) < 0.35
    places = found.poses.centres[rows]
    apart = np.linalg.norm(np.diff(places, axis=0), axis=1).mean()
    flown = np.linalg.norm(np.diff(found.poses.centres, axis=0), axis=1).mean()
    assert apart > 1.5 * flown
    assert set(flights[:5]) == {"survey"}
    assert set(photos(SEED ^ 1).names).isdisjoint(names)


def test_nobody_flies_the_survey_again() -> None:
    """Of a key its place and each photo's gusts are hidden."""
    public = photos(0).poses.centres[:10]
    hidden = photos(SEED).poses.centres[:10]
    assert np.linalg.norm(public - hidden, axis=1).min() > 1.0
    again = photos(SEED ^ 1).poses.centres[:10]
    assert np.linalg.norm(again - hidden, axis=1).min() > 1.0


def test_gusts_take_photos_off_any_smooth_line() -> None:
    """Who fits lines to the priors of neighbours is as far off as one prior is."""
    heights = photos(SEED).poses.centres[:20, 2]
    assert 1.0 < np.std(np.diff(heights, 2)) / 6**0.5 < 6.0
    assert np.std(np.diff(photos(0).poses.centres[:20, 2], 2)) < 0.1


def test_the_noise_of_priors_is_not_that_of_the_public_edition() -> None:
    poses, names = photos(SEED).poses, list(photos(SEED).names)
    ids = [f"city/{name}" for name in names]
    given = noisy_priors(ids, poses, derived(SEED, "priors of city"))
    off = given.centres - poses.centres
    assert 1.5 < off[:, :2].std() < 2.5
    for seed in (0, SEED & _MASK, SEED):
        guessed = noisy_priors(ids, poses, seed).centres - poses.centres
        assert np.abs(given.centres - guessed - poses.centres).max(axis=1).min() > 0.05


def test_conditions_are_as_often_as_in_public() -> None:
    public, sealed = photos(0), photos(SEED)
    rolled = slice(photos(SEED).sequence.count("survey"), None)
    shown = [*zip(sealed.weather[rolled], sealed.time_of_day[rolled], strict=True)]
    assert len(set(shown)) == len(set(zip(public.weather, public.time_of_day, strict=True)))


def test_the_key_stands_in_no_name_and_no_protocol(tmp_path: Path) -> None:
    text = str(world_folder(tmp_path, REGIONS["city"], derived(SEED, "worlds")))
    for protocol in mini_protocols(SEED).every:
        text += protocol.model_dump_json()
        assert protocol.benchmark == "airzoo-mini-sealed"
    for secret in (SEED, derived(SEED, "worlds"), int.from_bytes(KEY, "big")):
        for way in (str(secret), f"{secret:x}", hashlib.sha256(str(secret).encode()).hexdigest()):
            assert way not in text


def test_the_key_file(tmp_path: Path) -> None:
    file = tmp_path / "mini.key"
    file.write_text(KEY.hex() + "\n")
    assert MiniOptions(key_file=file).source == SEED
    with pytest.raises(UsageError, match="both given"):
        _ = MiniOptions(seed=3, key_file=file).source
    for text in ("", KEY.hex()[:-1], "g" * 32, KEY.hex() * 2):
        file.write_text(text)
        with pytest.raises(UsageError, match="holds no key"):
            _ = MiniOptions(key_file=file).source


def test_a_seed_is_no_key() -> None:
    with pytest.raises(UsageError, match="too large"):
        _ = MiniOptions(seed=1 << 64).source
    assert MiniOptions(seed=5).source == 5
