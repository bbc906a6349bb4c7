"""A body at the flange is a payload with its mass, centre and inertia; an inertia of the last link alone is none."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from arm_model import Arm, Joint
from arm_model.effects import described
from arm_model.rigid_body.inertia import about_com, barycentric
from arm_model.system import inverse_dynamics
from diagnosis.cause import Estimate
from diagnosis.measurements.currents.columns import candidates
from diagnosis.measurements.currents.design_matrix import Library, dataset_of
from diagnosis.measurements.currents.estimates import estimates_of
from diagnosis.measurements.currents.model import Currents
from diagnosis.measurements.currents.replacement.simplified import simplified
from diagnosis.measurements.currents.replacement.special_cases import special_cases
from diagnosis.measurements.currents.search import attributed_to_body
from diagnosis.residual.generation import residual_run
from diagnosis.residual.noise.channels import KnownNoise
from diagnosis.residual.run import Run
from diagnosis.selection.candidate import Candidate
from experiment.file import Payload
from identification.selection import Split, select

PLACES = ((0.0, -0.39, np.pi / 2), (0.13, 0.0, np.pi / 2), (0.1, 0.0, -np.pi / 2), (0.1, 0.0, 0.0))
MASSES = (2.8, 1.4, 1.3, 1.4)
LAST = len(MASSES)
NOISE = 0.02
CENTRE = (0.03, 0.01, 0.08)
SEARCHED = ("payload", "link_inertia", "rotor_inertia", "torque_constant", "joint_zero_offset", "viscous_friction")


@pytest.fixture(scope="module")
def arm() -> Arm:
    """Forearm and wrist of a collaborative robot."""
    joints = [
        Joint(
            d=d,
            a=a,
            alpha=alpha,
            mass=mass,
            com=(0.4 * -a, 0.0, 0.02),
            inertia=(0.003 * mass, 0.01 * mass, 0.01 * mass, 0.0, 0.0, 0.0),
            gear=101.0,
            rotor_inertia=3e-5,
            torque_constant=0.1,
            coulomb=(0.05, 0.05),
            viscous=(4e-4, 4e-4),
        )
        for (d, a, alpha), mass in zip(PLACES, MASSES)
    ]
    return Arm(name="forearm", joints=tuple(joints))


def carrying(arm: Arm, added: np.ndarray) -> Arm:
    """The arm with more barycentric parameters (10,) at its last link."""
    last = arm.joints[-1]
    mass, com, inertia = about_com(barycentric(last.mass, last.com, last.inertia) + added)
    return replace(arm, joints=(*arm.joints[:-1], replace(last, mass=mass, com=com, inertia=inertia)))


def box(mass: float, centre: Sequence[float], sides: Sequence[float]) -> tuple[np.ndarray, np.ndarray]:
    """(10,) barycentric parameters of a solid box, and its inertia (xx, yy, zz, 0, 0, 0) about its centre."""
    squares = np.square(sides)
    own = np.append(mass / 12 * (squares.sum() - squares), np.zeros(3))
    return barycentric(mass, tuple(centre), tuple(own)), own


def recorded(real: Arm, model: Arm, seed: int, shares: Sequence[float] = (1.0,) * LAST) -> Run:
    """12 s of all joints along Fourier series, of each a share, white noise in the currents."""
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, 12.0, 1 / 200)
    a, b = 0.4 * rng.normal(size=(2, 4, LAST)) / np.arange(1, 5)[:, None] * shares
    w = 0.2 * 2 * np.pi * np.arange(1, 5)
    sine, cosine = np.sin(np.outer(t, w)), np.cos(np.outer(t, w))
    q = np.array([-1.2, 1.0, 0.2, 0.5]) + sine @ a + cosine @ b
    v, acceleration = cosine @ (w[:, None] * a) - sine @ (w[:, None] * b), -sine @ (w[:, None] ** 2 * a)
    acceleration -= cosine @ (w[:, None] ** 2 * b)
    i = inverse_dynamics(real, q, v, acceleration) / model.joint_array("drive_constant")
    return residual_run("run", model, t, q, i + NOISE * rng.normal(size=i.shape), known=KnownNoise(still=NOISE))


def named(real: Arm, model: Arm) -> list[tuple[str, int | None, dict[str, Estimate]]]:
    """Effects, joints and parameters that a search over SEARCHED finds."""
    data = Split(dataset_of([recorded(real, model, 1)]), dataset_of([recorded(real, model, 2)]), False)
    library = Library((c for c in candidates(model) if c.effect in SEARCHED), data)
    state = simplified(attributed_to_body(select(Currents(model, data, library, []))))
    return [(c.effect, c.joint, {p.name: p for p in v}) for c, v in zip(state.chosen, estimates_of(state))]


@pytest.mark.parametrize("sides", [(0.15, 0.2, 0.12), (0.3, 0.06, 0.06)])
def test_a_solid_body_is_a_payload(arm: Arm, sides: tuple[float, float, float]) -> None:
    body, own = box(3.0, CENTRE, sides)
    ((effect, joint, found),) = named(carrying(arm, body), arm)
    assert (effect, joint) == ("payload", None)
    true = {"mass": 3.0, **dict(zip("xyz", CENTRE)), **dict(zip(("ixx", "iyy", "izz", "ixy", "iyz", "ixz"), own))}
    assert set(found) == set(true)
    for name, p in found.items():
        assert abs(p.value - true[name]) < 3 * p.std, name
    assert found["mass"].std < 0.2
    # the largest moment is more than noise
    assert found["izz"].value > 2 * found["izz"].std


@pytest.mark.parametrize("side", [0.0, 0.3])
def test_a_chosen_body_without_inertia_becomes_a_mass_point(arm: Arm, side: float) -> None:
    """It may have been chosen while another cause was missing, of which its inertia followed a part."""
    real = carrying(arm, box(3.0, CENTRE, (side, side / 2, side / 2))[0])
    data = Split(dataset_of([recorded(real, arm, 1)]), dataset_of([recorded(real, arm, 2)]), False)
    body = Candidate("payload", None, body=True)
    library = Library([replace(body, body=False)], data)
    state = Currents(arm, data, library, []).refitted([body], {body.key: ()})
    assert [c.body for c in special_cases(state).chosen] == [side > 0.0]


def test_a_mass_point_needs_no_inertia(arm: Arm) -> None:
    ((effect, joint, found),) = named(carrying(arm, box(1.0, CENTRE, (0.0, 0.0, 0.0))[0]), arm)
    assert (effect, joint, set(found)) == ("payload", None, {"mass", "x", "y", "z"})
    assert abs(found["mass"].value - 1.0) < 3 * found["mass"].std


@pytest.mark.parametrize(
    "added",
    [
        pytest.param([0.0, 0.0, 0.0, 0.0, 0.2, 0.0, 0.0, 0.15, 0.0, 0.1], id="inertia alone"),
        pytest.param([0.0, 0.1, 0.0, 0.2, 0.1, 0.0, 0.0, 0.1, 0.0, 0.1], id="centre"),
    ],
)
def test_a_change_of_the_last_link_that_is_no_body_is_no_payload(arm: Arm, added: list[float]) -> None:
    ((effect, joint, found),) = named(carrying(arm, np.array(added)), arm)
    assert (effect, joint) == ("link_inertia", LAST)
    for p, true in zip(found.values(), added):
        assert abs(p.value - true) < 3 * p.std, p.name


def test_a_rotor_is_not_the_inertia_of_a_payload(arm: Arm) -> None:
    body, _ = box(1.0, CENTRE, (0.0, 0.0, 0.0))
    loaded = carrying(arm, body)
    drive = replace(loaded.joints[-1], rotor_inertia=6e-5)
    found = named(replace(loaded, joints=(*loaded.joints[:-1], drive)), arm)
    assert {(effect, joint) for effect, joint, _ in found} == {("payload", None), ("rotor_inertia", LAST)}


def test_a_mass_point_and_a_rotor_are_the_body_that_explains_as_much(arm: Arm) -> None:
    """Of the two, the rotor is the first to enter where the inertia shows at the last joint almost alone."""
    body, own = box(3.0, CENTRE, (0.15, 0.2, 0.12))
    real = carrying(arm, body)
    data = Split(dataset_of([recorded(real, arm, 1)]), dataset_of([recorded(real, arm, 2)]), False)
    model = Currents(arm, data, Library(candidates(arm), data), [])
    both = [Candidate("payload", None), Candidate("rotor_inertia", LAST)]
    state = simplified(model.refitted(both, {c.key: [] for c in both}))
    assert [(c.effect, c.joint) for c in state.chosen] == [("payload", None)]
    found = {p.name: p for p in estimates_of(state)[0]}
    assert abs(found["izz"].value - own[2]) < 3 * found["izz"].std


def test_a_payload_is_no_inertia_of_a_link_before_the_last(arm: Arm) -> None:
    """Where the last joint hardly turns, ten coefficients of the link before it follow what a friction leaves, too."""
    loaded = carrying(arm, box(1.0, CENTRE, (0.0, 0.0, 0.0))[0])
    drive = replace(loaded.joints[0], viscous=(5e-4, 5e-4))
    real = replace(loaded, joints=(drive, *loaded.joints[1:]))
    fit, held_out = (dataset_of([recorded(real, arm, seed, (1.0, 1.0, 1.0, 0.01))]) for seed in (1, 2))
    data = Split(fit, held_out, False)
    model = Currents(arm, data, Library((c for c in candidates(arm) if c.effect in SEARCHED), data), [])
    both = [Candidate("link_inertia", LAST - 1), Candidate("viscous_friction", 1)]
    found = simplified(model.refitted(both, {c.key: [] for c in both}))
    assert {c.key for c in found.chosen} == {("payload", None), ("viscous_friction", 1)}
    assert abs(estimates_of(found)[0][0].value - 1.0) < 3 * estimates_of(found)[0][0].std


def test_a_rotor_is_no_inertia_of_the_next_link(arm: Arm) -> None:
    """Of its ten coefficients the rows determine eight: the link itself is no rival of fewer in its own place.

    Its centre of mass is 3 mm off, so that ten coefficients leave less than the rotor, by hundredths of the noise.
    """
    drive, link = replace(arm.joints[0], rotor_inertia=4.5e-5), arm.joints[1]
    off = replace(link, com=(link.com[0] + 0.003, *link.com[1:]))
    real = replace(arm, joints=(drive, off, *arm.joints[2:]))
    fit, held_out = (dataset_of([recorded(real, arm, seed, (1.0, 0.3, 0.0, 0.0))]) for seed in (1, 2))
    data = Split(fit, held_out, False)
    model = Currents(arm, data, Library((c for c in candidates(arm) if c.effect in SEARCHED), data), [])
    body, rotor = Candidate("link_inertia", 2), Candidate("rotor_inertia", 1)
    state, of_rotor = (model.refitted([c], {c.key: []}) for c in (body, rotor))
    own = model.conditional(body, model.start(), state)
    assert 1 < own.determined < np.count_nonzero(own.coefficients)
    assert 0.0 < of_rotor.energy.held_out - state.energy.held_out < 0.1 * data.held_out.rows
    assert {c.key for c in simplified(state).chosen} == {rotor.key}


def test_a_payload_in_a_model_is_the_body(arm: Arm) -> None:
    body, own = box(3.0, CENTRE, (0.3, 0.1, 0.05))
    setup = Payload(mass=3.0, com=CENTRE, inertia=tuple(own))
    arm_with = described(arm.with_effect("payload", **setup.parameters)).joints[-1]
    expected = carrying(arm, body).joints[-1]
    assert arm_with.mass == pytest.approx(expected.mass) and arm_with.com == pytest.approx(expected.com)
    assert arm_with.inertia == pytest.approx(expected.inertia)


@pytest.mark.parametrize("seed", [1, 3, 5])
def test_what_a_motion_does_not_show_of_a_link_is_no_larger_than_typical(arm: Arm, seed: int) -> None:
    """One joint moved in the fitted recording: ten coefficients followed its noise, and no other motion."""
    real = carrying(arm, box(1.0, CENTRE, (0.0, 0.0, 0.0))[0])
    fit, held_out = (
        dataset_of([recorded(real, arm, seed + k, shares)])
        for k, shares in enumerate(((0.002, 1.0, 0.002, 0.002), (0.3, 1.0, 0.3, 0.3)))
    )
    data = Split(fit, held_out, False)
    model = Currents(arm, data, Library(candidates(arm), data), [])
    state = model.refitted([Candidate("link_inertia", LAST)], {("link_inertia", LAST): []})
    # 0.14 to 1.2 of it was left
    assert state.energy.held_out < 0.05 * model.start().energy.held_out
    # where one joint moves, no more of a link shows than its weight, its inertia and what they couple to the others
    score = model.conditional(state.chosen[0], model.start(), state)
    assert np.count_nonzero(score.coefficients) == 10 and 3 <= score.determined < 10


@pytest.mark.parametrize(("mass", "expected"), [(0.2, (0.0, 0.1)), (3.0, (0.2, 1.0))])
def test_a_link_is_expected_to_be_wrong_by_as_much_as_the_recordings_show(
    arm: Arm, mass: float, expected: tuple[float, float]
) -> None:
    """Of a twentieth of what is typical, ten coefficients followed the noise of the fitted poses: others were worse."""
    link = arm.joints[1]
    changed = barycentric(link.mass, link.com, link.inertia) + box(mass, CENTRE, (0.05, 0.05, 0.05))[0]
    values = dict(zip(("mass", "com", "inertia"), about_com(changed)))
    real = replace(arm, joints=(arm.joints[0], replace(link, **values), *arm.joints[2:]))
    runs = recorded(real, arm, 1, (0.2, 0.2, 0.2, 0.0)), recorded(real, arm, 2)
    data = Split(*(dataset_of([run]) for run in runs))
    model = Currents(arm, data, Library((Candidate("link_inertia", 2),), data), [])
    (found,) = model.scores(model.start())
    typical = model.conditional(Candidate("link_inertia", 2), model.start(), model.start())
    assert expected[0] < found.candidate.expected <= expected[1]
    # at the three joints that carry the link, less than the noise that is stated
    assert found.gain > typical.gain and found.gain > 0.6 * data.held_out.rows
    if mass < 1.0:
        assert typical.gain < 0.0
