"""What each check finds in tables as people type them, and what it leaves alone."""

from __future__ import annotations

import pytest

from airzoo_bench.audit.counts import parse_counts
from airzoo_bench.audit.values import read_score, read_values
from tests.audit.support import audited, published, rows_of_wide, told

R = "method,scene,R@1"
AVERAGE = f"{R}; A,S0,10.00; A,S1,20.00; A,S2,40.00; A,Average,"
MEDIANS = "method,scene,median error; A,S0,2.0; A,S1,4.0; A,Average,"
GAIN = f"{R}; C,East,1.00; X,East,26.91; X (Ours),East,28.64"
ERROR_GAIN = "method,scene,median error; C,East,1.00; X,East,26.91; X (Ours),East,25.18"
BEST = "method,scene,R@1,R@3,F1; A,East,10.0,30.0,20.0; B,East,20.0,25.0,40.0; Y,East,25.0 (+5.0),"
POOLED = "method,scene,n,R@1; A,City,10,10.00; A,Rural,90,90.00; A,Average,,50.00; A,Pooled,100,"
ROUNDED_PARTS = f"{R}; A,S0,21.12; A,S1,4.21; A,Average,"
DEFINITION = """method,scene,R@1,R@3,R@5,AP@5; AnyLoc,City,3.73,8.70,9.32,2.61;
SALAD,City,8.70,21.12,31.06,8.07; AnyLoc,Rural,5.26,10.00,11.58,3.26;
SALAD,Rural,6.32,17.89,28.42,7.37; MegaLoc,Rural,27.37,58.42,70.00,24.74;
MegaLoc,City,9.94,22.98,31.06,"""
POSES = 'method,scene,"recall@(5m,1deg)","recall@(10m,1deg)"; A,East,50.0,49.0'
BOTH = "City=161,Rural=190"

# A table, the counts that are given, and the findings: grade, check, method, score.
CASES = [
    ("method,scene,R@1,R@3,R@5; A,East,10.0,9.9,12.0", "", "impossible order A R@1"),
    ("method,scene,R@1,R@3; A,East,10.04,10", "", ""),
    ("method,scene,R@1,R@3; A,East,10.04,10.0", "", ""),
    ("method,scene,R@1,R@3; A,East,10.51,10", "", "impossible order A R@1"),
    (POSES, "", "impossible order A recall@(5m,1deg)"),
    ("method,scene,F1@1m,F1@5m,P@5m; A,s1,50.00,40.00,60.00", "", "impossible order A F1@1m"),
    ("method,scene,R@1,R@5; A,East,96.21,96.23", "East=264", "impossible counts A R@5"),
    ("method,scene,R@1,R@5; A,East,3.78,96.97", "East=264", "rounding counts A R@1"),
    ("method,scene,R@1,R@5; A,East,96.22,96.97", "East=264", "rounding counts A R@1"),
    (f"{R}; A,City,50.00; A,Rural,25.00; A,Average,37.50", "City=4,Rural=4,Average=3", ""),
    (DEFINITION + "8.94", "", ""),
    (DEFINITION + "8.98", BOTH, "inconsistent counts MegaLoc AP@5"),
    (AVERAGE + "23.33", "", ""),
    # 1/10, 4/20, 28/70: 33 of 100.
    (AVERAGE + "33.00", "S0=10,S1=20,S2=70", ""),
    (AVERAGE + "24.00", "S0=10,S1=10,S2=10", "inconsistent average A R@1"),
    # 24.00 may be over all queries; 41.00 is more than any scene has.
    (AVERAGE + "24.00", "", ""),
    (AVERAGE + "41.00", "", "inconsistent average A R@1"),
    (MEDIANS + "2.2", "", ""),
    (MEDIANS + "4.9", "", "inconsistent average A median error"),
    # 34/161 and 8/190 have the mean 12.664; as printed 21.12 and 4.21 they have 12.665.
    (ROUNDED_PARTS + "12.67", "S0=161,S1=190", "rounding average A R@1"),
    (ROUNDED_PARTS + "12.66", "S0=161,S1=190", ""),
    (POOLED + "82.00", "", ""),
    (POOLED + "50.00", "", "inconsistent average A R@1"),
    (GAIN + " (+1.73)", "", ""),
    (GAIN + " (1.73)", "", ""),
    (GAIN + " (+1.74)", "", "rounding gain X (Ours) R@1"),
    (GAIN + " (+1.75)", "", "inconsistent gain X (Ours) R@1"),
    (ERROR_GAIN + " (-1.73)", "", ""),
    (ERROR_GAIN + " (+1.73)", "", ""),
    (BEST + "31.0 (+1.0),42.0 (+2.0)", "", ""),
    (BEST + "31.0 (+1.0),42.0 (+3.0)", "", "inconsistent gain Y F1"),
    (f"{R}; A,East,10.0; B,East,20.0; C,East,20.0", "", ""),
    (f"{R}; A,East,10.0; B,East,**20.0**; C,East,**20.0**", "", ""),
    (f"{R}; A,East,**10.0**; B,East,**20.0**", "", "inconsistent bold A R@1"),
    (f"{R}; A,East,**20.0**; B,East,20.0", "", "rounding bold B R@1"),
]


@pytest.mark.parametrize(("text", "counts", "finding"), CASES)
def test_what_is_found(text: str, counts: str, finding: str) -> None:
    found = audited(rows_of_wide(text), parse_counts([counts] if counts else []))
    assert [" ".join(one) for one in told(found)] == [finding] * bool(finding)


def test_nothing_is_concluded_from_an_impossible_row() -> None:
    text = "method,scene,R@1,R@5,AP@5; A,City,7.45,28.57,7.20; B,City,27.37,23.16,3.42"
    notes = audited(rows_of_wide(text)).notes
    assert sum("it cannot be told which" in note for note in notes) == 1


def test_a_given_count_beside_the_one_that_the_values_tell() -> None:
    notes = audited(rows_of_wide(DEFINITION + "8.94"), parse_counts(["City=322"])).notes
    assert sum("n = 161" in note and "322" in note for note in notes) == 1


# Names of scores, by kind and by whether more is better.
SCORES = {
    ("hits", True): ["R@1", "Recall@5", "recall@(5m,1deg)", "Acc@10m", "@20m", "R@1%"],
    ("ap", True): ["AP@5"],
    ("cloud", True): ["F1 ↑", "F-score", "Precision", "Recall"],
    ("other", False): ["Chamfer distance", "CD", "median_translation_error", "Med. ↓", "ATE"],
    ("other", True): ["nDCG@10", "mAP", "AUC@5"],
    ("other", None): ["Comp", "beauty", "R@", "AP@0"],
}
VARIANTS = {"AP@5": "", "AP@5/trec": "trec", "ap@5/min": "min", "P@5": "precision"}


def test_scores_are_known_by_their_names() -> None:
    for known, names in SCORES.items():
        for name in names:
            score = read_score(name)
            assert (name, score.kind, score.better) == (name, *known)
    for name, variant in VARIANTS.items():
        assert (read_score(name).places, read_score(name).variant) == (5, variant)


@pytest.mark.parametrize(("unit", "full"), [("share", 1), ("%", 100), ("", 1)])
def test_shares_from_0_to_1(unit: str, full: int) -> None:
    rows = [{"method": "A", "scene": "E", "metric": "R@1", "value": "0.5", "unit": unit}]
    assert [value.full for value in read_values(published(rows))] == [full]
