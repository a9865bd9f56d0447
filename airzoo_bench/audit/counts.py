"""Shares as counts: of how many queries each scene is, and which shares are no whole number."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from collections.abc import Set as AbstractSet
from dataclasses import dataclass
from fractions import Fraction

import numpy as np
from scipy.special import bdtrc

from airzoo_bench.audit.findings import Conclusion, Finding, Grade, Outcome
from airzoo_bench.core.errors import ResultError, UsageError, agreeing, counted, first_of
from airzoo_bench.core.validation import nearest
from airzoo_bench.tables.printed import Family, Rounded, Span
from airzoo_bench.tables.published import PrintedValue, Published, grouped

__all__ = [
    "Key",
    "Queries",
    "check_counts",
    "check_precision",
    "define_precision",
    "parse_counts",
    "resolve_queries",
]

Key = tuple[str, str, str]
"""What has one number of queries: benchmark, track and scene."""

_SURE = 0.99  # so sure must a number of queries be that was not given
_LARGEST = 100_000  # from 10^(decimals + 2) on every percentage is a count
# How often a printed share is no count at all. That rare, a misprint does not speak for half a
# total only because the other counts happen to be even.
_MISPRINT = 1e-3
_FEWEST_CUTS = 3  # of one scene, so that its digits were cut off for certain
_SHOWN = 3
_RARE = 1e-4  # so rarely may so many values be whole numbers by chance
_MOST_MISFITS = 0.1
_FEWEST = 3  # from so many values on one may be a misprint


@dataclass(frozen=True)
class Queries:
    """How many queries a scene has, given by the user or the file, or else concluded."""

    number: int
    is_given: bool


def key_of(cell: PrintedValue) -> Key:
    """Return what has one number of queries."""
    return *cell.group, cell.scene


def score_of(cell: PrintedValue) -> Key:
    """Return what has one definition: benchmark, track and score."""
    return *cell.group, cell.score.name


def decimal_text(number: Fraction, decimals: int) -> str:
    """Write an exact number with `decimals` decimals, halves away from zero."""
    scaled = abs(number) * 10**decimals
    digits = str((2 * scaled.numerator + scaled.denominator) // (2 * scaled.denominator))
    sign = "-" if number < 0 and int(digits) else ""
    if decimals == 0:
        return sign + digits
    digits = digits.rjust(decimals + 1, "0")
    return f"{sign}{digits[:-decimals]}.{digits[-decimals:]}"


def possible_counts(number: Rounded, total: int, full: int = 100) -> range:
    """Return the counts out of a total that round to a printed share, halves either way."""
    scaled = number.span.times(Fraction(total, full))
    return range(max(0, math.ceil(scaled.low)), min(total, math.floor(scaled.high)) + 1)


def counted_share(number: Rounded, total: int, full: int = 100) -> Span:
    """Return where the true share lies in printed units, narrowed to counts where any fits."""
    counts = possible_counts(number, total, full)
    if not counts:
        return number.span
    return Span(Fraction(counts[0] * full, total), Fraction(counts[-1] * full, total))


def parse_counts(texts: Iterable[str]) -> dict[str, int]:
    """Read ``scene=n,...`` texts."""
    counts: dict[str, int] = {}
    for part in (part.strip() for text in texts for part in text.split(",")):
        match = re.fullmatch(r"(.*\S)\s*=\s*0*([1-9][0-9]{0,8})", part)
        if not match or match[1] in counts:
            raise UsageError(
                f"{part[:80]!r} is no scene and number of queries, or a scene stands twice",
                where="--counts",
                expected="such as 'City=161,Rural=190', or 'AirZoo-Real/City=161' where several "
                "benchmarks have a scene of that name",
            )
        counts[match[1]] = int(match[2])
    return counts


def is_average(published: Published) -> Callable[[PrintedValue], bool]:
    """Return what tells averages over scenes from the only set there is."""
    with_scenes = {
        (cell.group, cell.score.name)
        for cell in published.cells
        if not cell.is_summary and cell.score.is_share
    }
    return lambda cell: cell.is_summary and (cell.group, cell.score.name) in with_scenes


def resolve_queries(
    published: Published,
    counts: Mapping[str, int],
    precise: Collection[Key],
    doubtful: AbstractSet[tuple[str, ...]],
) -> tuple[dict[Key, Queries], list[Conclusion]]:
    """Return the number of queries of each scene that has shares of queries, where it is known.

    `precise` are the benchmarks, tracks and names of scores that are mean precision; rows that hold
    something impossible are doubtful.
    """
    groups = published.by(key_of)
    scenes = {scene for _, _, scene in groups}
    known = scenes | {f"{benchmark}/{scene}" for benchmark, _, scene in groups if benchmark}
    for name in counts:
        if name not in known:
            raise UsageError(
                f"no scene {name!r}{nearest(name, sorted(known))}",
                where="--counts",
                expected=first_of(sorted(scenes), shown=20),
            )
    averaged = is_average(published)
    queries: dict[Key, Queries] = {}
    conclusions: list[Conclusion] = []
    for key, cells in groups.items():
        given = _stated_count(cells, counts)
        own = [cell for cell in cells if not averaged(cell)]
        implied = _implied([cell for cell in own if cell.row not in doubtful], precise)
        if given is not None:
            queries[key] = Queries(given, True)
        elif implied and implied.probability >= _SURE:
            queries[key] = Queries(implied.total, False)
        if implied:
            text = _implied_text(implied, given, own)
            conclusions.append(Conclusion("counts", ", ".join(filter(None, key)), text))
    return queries, conclusions


def _stated_count(cells: Sequence[PrintedValue], counts: Mapping[str, int]) -> int | None:
    first = cells[0]
    stated = {cell.queries: f"line {cell.line}" for cell in cells if cell.queries is not None}
    for name in (f"{first.benchmark}/{first.scene}", first.scene):
        # The name with its benchmark is the more exact one.
        if name in counts:
            stated[counts[name]] = "--counts"
            break
    if len(stated) > 1:
        shown = ", ".join(f"{n} ({where})" for n, where in stated.items())
        raise ResultError(
            f"different numbers of queries for {first.place}: {shown}",
            expected="one number a scene",
        )
    return next(iter(stated), None)


@dataclass(frozen=True)
class _Implied:
    """The likeliest total of several shares, how many of them fit, and what fits as well."""

    total: int
    fits: int
    values: int
    probability: float
    as_good: tuple[int, ...]


def _implied(cells: Sequence[PrintedValue], precise: Collection[Key]) -> _Implied | None:
    """Weigh all totals by Bayes' rule: out of how many queries several printed shares are counts.

    A value that fits is one of as many as there are counts, one that does not is a misprint, and
    larger totals are less likely beforehand, in proportion.
    """
    hits = [cell for cell in cells if cell.score.family is Family.HITS]
    if not hits:  # average precision alone would take its definition on trust
        return None
    told = sorted(
        {
            (cell.number.value, cell.number.decimals, cell.full, cell.score.cutoff or 1)
            for cell in [*hits, *(c for c in cells if score_of(c) in precise)]
            if 0 < cell.number.value < cell.full
        }
    )
    if not told:
        return None
    largest = min(_LARGEST, max(full * 10**decimals for _, decimals, full, _ in told))
    totals = np.arange(1, largest + 1, dtype=np.int64)
    fits, merit = np.zeros(largest, np.int64), -np.log(totals)
    for value, decimals, full, places in told:
        steps, values = 2 * int(value * 10**decimals), full * 10**decimals
        # At most 2 x 10^11 x 10^5 x 10^2: no overflow.
        lowest = -((-(steps - 1) * totals * places) // (2 * values))
        fit = lowest <= ((steps + 1) * totals * places) // (2 * values)
        chance = _chance(totals * places, values)
        fits += fit
        merit += np.where(fit, -np.log(chance), math.log(_MISPRINT))
    best = int(np.argmax(merit))
    as_good = totals[(totals > totals[best]) & (fits >= fits[best])][:_SHOWN]
    rivals = float(np.exp(merit - merit[best]).sum()) + math.exp(-max(merit[best], -700.0))
    return _Implied(
        int(totals[best]), int(fits[best]), len(told), 1 / rivals, tuple(as_good.tolist())
    )


def _chance(totals: np.ndarray, values: int) -> np.ndarray:
    """Return the share of all printed values that are counts of each total."""
    halves = np.gcd(totals, 2 * values) - np.gcd(totals, values)
    return np.asarray(np.minimum(1.0, (totals + halves) / values))


def _implied_text(implied: _Implied, given: int | None, own: Sequence[PrintedValue]) -> str:
    values = f"{implied.fits} of {implied.values} different values"
    if implied.probability < _SURE:
        told = f"n is given as {given}" if given is not None else "n cannot be told"
        others = ", ".join(map(str, implied.as_good)) or "no other"
        return f"{told}; n = {implied.total} fits {values}, so do {others}"
    text = f"n = {implied.total} fits {values}"
    if implied.as_good:
        multiples = all(total % implied.total == 0 for total in implied.as_good)
        others = "its multiples" if multiples else ", ".join(map(str, implied.as_good))
        text += f", as do {others}"
    if given in (None, implied.total):
        return text + "; it is the n given" * (given is not None)
    hits = {
        c.number: c for c in own if c.score.family is Family.HITS and 0 < c.number.value < c.full
    }
    fits = sum(bool(possible_counts(c.number, given or 0, c.full)) for c in hits.values())
    text += f"; the n given is {given}, which fits {fits}"
    left = (given or 0) - implied.total
    if left > 0 and fits < implied.fits:
        text += f": {agreeing(left, 'was', 'were')} {counted(left, 'query')} left out?"
    return text


@dataclass(frozen=True)
class Share:
    """A printed share of a known number of queries, or of K places of each of them.

    It is sure where the number of queries, and what the share is of, were given.
    """

    cell: PrintedValue
    queries: Queries
    places: int
    is_sure: bool

    @property
    def total(self) -> int:
        """Queries, or places of all queries."""
        return self.queries.number * self.places

    @property
    def exact(self) -> Fraction:
        """How many the printed digits are."""
        return self.cell.number.value * self.total / self.cell.full

    @property
    def fits(self) -> bool:
        """Whether a whole number rounds to it."""
        return bool(possible_counts(self.cell.number, self.total, self.cell.full))

    @property
    def is_cut(self) -> bool:
        """Whether it is a whole number with its further digits cut off."""
        count, step = math.ceil(self.exact), 2 * self.cell.number.half * self.total / self.cell.full
        return count <= self.total and count < self.exact + step

    @property
    def near(self) -> list[int]:
        """The whole numbers next to it."""
        ends = (math.floor(self.exact), math.ceil(self.exact))
        return sorted({min(max(count, 0), self.total) for count in ends})

    @property
    def is_near(self) -> bool:
        """Whether some count is less than one last digit away, however it was rounded."""
        step = 2 * self.cell.number.half * self.total / self.cell.full
        return any(abs(count - self.exact) < step for count in self.near)


def check_counts(published: Published, queries: Mapping[Key, Queries]) -> Outcome:
    """Find shares of queries that are no whole number of queries."""
    averaged = is_average(published)
    hits = [cell for cell in published.cells if cell.score.family is Family.HITS]
    of_scenes = [cell for cell in hits if not averaged(cell)]
    known = [cell for cell in of_scenes if key_of(cell) in queries]
    shares = [Share(c, queries[key_of(c)], 1, queries[key_of(c)].is_given) for c in known]
    findings, conclusions = judge_shares("counts", shares)
    number = counted(len({key_of(cell) for cell in known}), "scene")
    what = f"shares of queries in {number}, whether each is a whole number of queries"
    left = [] if hits else ["no share of queries, such as R@1, is printed"]
    averages = len(hits) - len(of_scenes)
    if averages:
        are = agreeing(averages, "which is", "which are")
        left.append(f"{counted(averages, 'average')} over scenes, {are} no share of queries")
    unknown = [cell for cell in of_scenes if key_of(cell) not in queries]
    if unknown:
        scenes = list(dict.fromkeys(cell.place for cell in unknown))
        names = ", ".join(scenes[:3]) + (" ..." if len(scenes) > 3 else "")
        left.append(
            f"{counted(len(unknown), 'share')} in {names}, whose number "
            "of queries is not known and the values do not tell: give it by --counts"
        )
    outcome = "; ".join(left), tuple(findings), tuple(conclusions), tuple(known)
    return Outcome("counts", len(shares), what, *outcome)


def define_precision(
    published: Published,
    queries: Mapping[Key, Queries],
    variant: str | None,
    doubtful: AbstractSet[tuple[str, ...]],
) -> set[Key]:
    """Tell which average precisions are mean precision: by name, as given, or by whole numbers.

    Mean precision at K is a whole number of positives out of K for each query.
    """
    found = set()
    for name, cells in _precisions(published).items():
        told = cells[0].score.variant or variant
        shares = _places([cell for cell in cells if cell.row not in doubtful], queries, False)
        fits, by_chance = sum(share.fits for share in shares), _fits_by_chance(shares)
        misfits = len(shares) - fits
        # One misprint of several values must not hide what all others are.
        tolerated = max(len(shares) >= _FEWEST, int(len(shares) * _MOST_MISFITS))
        luck = float(bdtrc(fits - 1, len(shares), by_chance / len(shares))) if fits else 1.0
        if told == "precision" or (told is None and misfits <= tolerated and luck < _RARE):
            found.add(name)
    return found


def _precisions(published: Published) -> dict[Key, list[PrintedValue]]:
    cells = [c for c in published.cells if c.score.family is Family.AVERAGE_PRECISION]
    return grouped(cells, score_of)


def _places(
    cells: Iterable[PrintedValue], queries: Mapping[Key, Queries], is_given: bool
) -> list[Share]:
    """Return values of scenes with a known number of queries as shares of K places each."""
    known = [(cell, queries[key_of(cell)]) for cell in cells if key_of(cell) in queries]
    return [
        Share(cell, n, cell.score.cutoff, n.is_given and is_given)
        for cell, n in known
        if not cell.is_summary
    ]


def _fits_by_chance(shares: Sequence[Share]) -> float:
    """Return how many of shares would be a whole number by chance; of no positives at all, each."""
    values = [share.cell.full * 10**share.cell.number.decimals for share in shares]
    return sum(
        float(_chance(np.array(share.total), n)) if share.cell.number.value else 1.0
        for share, n in zip(shares, values, strict=True)
    )


def check_precision(
    published: Published,
    queries: Mapping[Key, Queries],
    precise: Collection[Key],
    variant: str | None,
) -> Outcome:
    """Find mean precisions that are no whole number of positives."""
    shares, conclusions, scenes = [], [], 0
    for name, cells in _precisions(published).items():
        told = cells[0].score.variant or variant
        own = _places(cells, queries, told is not None)
        text = "it cannot be told which"
        if name in precise or told:
            what = "mean precision" if name in precise else f"that of {told}"
            text = f"the definition is {what} ({'given' if told else 'concluded'})"
        if own:
            text += (
                f"; {sum(share.fits for share in own)} of {len(own)} values in scenes are whole "
                "numbers of positives, as mean precision must be, and by chance "
                f"{_fits_by_chance(own):.1f} would be"
            )
        conclusions.append(Conclusion("AP", ", ".join(filter(None, name)), text))
        shares += own if name in precise else []
        scenes += sum(not cell.is_summary for cell in cells)
    findings, cut = judge_shares("AP counts", shares)
    unknown = scenes - len(shares)
    left = f"{unknown} that are not mean precision, or of queries of unknown number"
    none = "no average precision such as AP@5 is printed in a scene"
    return Outcome(
        "AP counts",
        len(shares),
        "mean precisions, whether each is a whole number of positives",
        left if unknown else none * (not scenes),
        tuple(findings),
        (*conclusions, *cut),
        tuple(share.cell for share in shares),
    )


def judge_shares(check: str, shares: Sequence[Share]) -> tuple[list[Finding], list[Conclusion]]:
    """Find shares that are no count, table by table."""
    findings: list[Finding] = []
    conclusions: list[Conclusion] = []
    for table, own in grouped(shares, lambda share: share.cell.table).items():
        wrong = [share for share in own if not share.fits]
        all_cut = bool(wrong) and all(share.is_cut for share in own)
        cut = all_cut or _shows_cuts(wrong, own)
        if cut:
            told = f"so all {len(own)} shares are counts" if all_cut else "as one scene shows"
            text = f"digits are cut off, not rounded: {told}"
            conclusions.append(Conclusion(check, table, text))
        findings.extend(_no_count(check, share, cut=cut) for share in wrong)
    return findings, conclusions


def _shows_cuts(wrong: Sequence[Share], own: Sequence[Share]) -> bool:
    """Whether some scene shows that a table cuts: other concluded numbers of queries are in doubt.

    All shares of that scene are counts whose digits were cut off, and several of them no others.
    """
    if any(share.queries.is_given and not share.is_cut for share in wrong):
        return False
    scenes = Counter(key_of(share.cell) for share in wrong if share.is_cut)
    whole = {key_of(share.cell) for share in own if not share.is_cut}
    return any(number >= _FEWEST_CUTS and scene not in whole for scene, number in scenes.items())


def _no_count(check: str, share: Share, *, cut: bool) -> Finding:
    cell, number, total, n = share.cell, share.cell.number, share.total, share.queries.number
    unit = " %" if cell.full == 100 else ""
    of, things = counted(n, "query"), "queries"
    if share.places > 1:
        of, things = f"{share.places} x {n} = {total} places of mean precision", "positives"
    near = ", ".join(
        f"{count}/{total} = {decimal_text(Fraction(count * cell.full, total), number.decimals)}"
        for count in share.near
    )
    exact = decimal_text(share.exact, 2)
    why = f"{number.text}{unit} of {of} is {exact} {things}, no whole number: {near}"
    if not share.queries.is_given:
        why += f" (n = {n} is what the other values of the scene imply)"
    if share.is_near:
        way = "cut off, not rounded" if share.is_cut else "as if rounded up, or twice"
        why += f": off by the last digit, {way}"
    grade = Grade.IMPOSSIBLE if share.is_sure else Grade.INCONSISTENT
    return Finding(Grade.ROUNDING if share.is_near or cut else grade, check, cell, why)
