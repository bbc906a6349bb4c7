"""The statistics of a comparison on numbers whose truth is known."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from comparison.change import Change, Estimate, Kind, Quantity
from comparison.significance import changes, moderate

SIZE = 40


def quantities(kind: Kind = "inertia", count: int = SIZE) -> list[Quantity]:
    return [Quantity(name=f"q{k}", words=f"q{k}", unit="", kind=kind) for k in range(count)]


def side(rng: np.random.Generator, recordings: int, scatter: float, shift: np.ndarray, freedom: float = 60.0):
    """Estimates of deviation 1 as stated, which scatter ``scatter`` times as much."""
    found = []
    for _ in range(recordings):
        values = shift + scatter * rng.standard_normal(len(shift))
        ones = np.ones(len(shift))
        found.append(Estimate(source="", values=values, std=1.02 * ones, raw=ones, freedom=freedom))
    return found


def named(found: list[Change]) -> np.ndarray:
    return np.array([one.significant for one in found])


@pytest.mark.parametrize(("recordings", "scatter"), [(1, 1.0), (2, 1.0), (2, 3.0), (3, 3.0), (6, 3.0)])
def test_false_discoveries_stay_at_their_rate(recordings: int, scatter: float) -> None:
    """Nothing changed: in at most one comparison of twenty is anything named, however small the stated deviations."""
    rng, nothing, trials = np.random.default_rng(recordings), np.zeros(SIZE), 300
    false = 0
    for _ in range(trials):
        sides = [side(rng, recordings, scatter, nothing) for _ in range(2)]
        false += named(changes(quantities(), *sides)).any()
    # 0.05 and three of its standard deviations
    assert false / trials < 0.05 + 3 * (0.05 * 0.95 / trials) ** 0.5


def test_change_above_the_scatter_is_found() -> None:
    """In groups that scatter three times as much as they say; 5 % of what is named may be false."""
    rng, shift, trials, hits, false = np.random.default_rng(0), np.zeros(SIZE), 100, 0, 0.0
    shift[7] = 15.0
    for _ in range(trials):
        found = changes(quantities(), side(rng, 3, 3.0, 0 * shift), side(rng, 3, 3.0, shift))
        hits += found[7].significant
        false += (named(found).sum() - found[7].significant) / max(named(found).sum(), 1)
        assert found[7].std == pytest.approx(3.0 * (2 / 3) ** 0.5, rel=0.4)
    assert hits >= 0.95 * trials
    assert false <= 0.1 * trials
    assert np.mean([one.scatter for one in found]) == pytest.approx(3.0, rel=0.3)


def test_single_pair_is_the_difference_over_the_joint_deviation() -> None:
    rng = np.random.default_rng(1)
    a, b = side(rng, 1, 1.0, np.zeros(SIZE)), side(rng, 1, 1.0, np.zeros(SIZE))
    for k, one in enumerate(changes(quantities(), a, b)):
        assert one.change == pytest.approx(b[0].values[k] - a[0].values[k])
        assert one.std == pytest.approx(1.02 * 2**0.5) and one.scatter is None
        assert one.p == pytest.approx(2 * stats.t.sf(abs(one.change) / 2**0.5, 120))


@pytest.mark.parametrize(("shared", "significant"), [(0.0, True), (10.0, False)])
def test_what_both_sides_may_have_wrong_alike_is_in_the_test_of_a_change(shared: float, significant: bool) -> None:
    ones = np.ones(2)
    sides = [
        [Estimate(source="", values=np.array([shift, 0.0]), std=ones, raw=ones, freedom=60.0)] for shift in (0.0, 8.0)
    ]
    one, _ = changes(quantities(count=2), *sides, np.array([shared, 0.0]))
    assert one.std == pytest.approx(np.hypot(2**0.5, shared))
    assert one.significant is significant


def test_a_recording_that_says_nothing_is_left_out() -> None:
    rng = np.random.default_rng(2)
    before, after = side(rng, 2, 1.0, np.zeros(3)), side(rng, 2, 1.0, np.zeros(3))
    before[0].values[0] = np.nan
    for one in after:
        one.values[1] = np.nan
    found = changes(quantities(count=3), before, after)
    assert found[0].before == pytest.approx(before[1].values[0]) and found[0].comparable
    assert found[1].quantity.why == "one side does not determine it" and found[1].p is None
    assert found[2].comparable


def test_many_changed_points_of_a_curve_let_nothing_else_through() -> None:
    """Ten changed points and one other quantity with p = 0.008: among eleven alone that would be called significant."""
    curve = [Quantity(name=f"p{k}", words="", unit="N m", kind="curve", joint=3, speed=0.1 * k) for k in range(10)]
    other = quantities(count=30)
    shift = np.array([20.0] * 10 + [2.65 * 2**0.5] + [0.0] * 29)
    ones = np.ones(40)
    pair = [Estimate(source="", values=v, std=ones, raw=ones, freedom=1e6) for v in (0 * shift, shift)]
    found = changes(curve + other, pair[:1], pair[1:])
    assert found[10].p == pytest.approx(0.008, rel=0.02)
    assert float(stats.false_discovery_control([one.p for one in found])[10]) < 0.05
    assert named(found).tolist() == [True] * 10 + [False] * 30


def test_a_point_of_a_curve_is_no_surer_than_its_curve() -> None:
    """Of two points one has p = 0.001: 0.002 among the two, and 0.08 among the curve and 39 other quantities."""
    curve = [Quantity(name=f"p{k}", words="", unit="N m", kind="curve", joint=1, speed=0.1 * k) for k in range(2)]
    shift = np.array([3.2905, 0.3, *[0.3] * 39]) * 2**0.5
    ones = np.ones(41)
    pair = [Estimate(source="", values=v, std=ones, raw=ones, freedom=1e6) for v in (0 * shift, shift)]
    found = changes(curve + quantities(count=39), pair[:1], pair[1:])
    assert found[0].p == pytest.approx(0.001, rel=0.01)
    assert found[0].corrected == pytest.approx(40 * 0.002, rel=0.01)
    assert not named(found).any()


def test_moderation_recovers_the_common_scatter() -> None:
    rng = np.random.default_rng(3)
    freedom = np.full(400, 4.0)
    alike, left = moderate(9.0 * rng.chisquare(4, 400) / 4, freedom)
    assert alike == pytest.approx(9.0, rel=0.35) and (left > 30).all()
    # Quantities that scatter differently keep what is their own.
    mixed = np.where(np.arange(400) % 2, 1.0, 400.0)
    moderated, left = moderate(mixed * rng.chisquare(4, 400) / 4, freedom)
    assert (left < 8).all() and np.median(moderated[::2]) > 50 * np.median(moderated[1::2])


def test_a_share_is_as_sure_as_the_change_that_it_is() -> None:
    """Of a joint fit the change is known better than either value: they are of one regression."""
    quantity = Quantity(name="link6.mx", words="first moment x of link 6", unit="kg m", kind="inertia", joint=6)
    std_before, std = 0.0035, 0.00088
    after = float(np.hypot(std_before, std))
    one = Change(quantity=quantity, before=0.172, after=0.181, std_before=std_before, std_after=after, std=std)
    assert one.z == pytest.approx(0.009 / std)
    share = 0.009 / 0.172
    assert one.relative == pytest.approx((share, np.hypot(std, share * std_before) / 0.172))
