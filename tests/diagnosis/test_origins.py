"""Physical origins of named causes: the table is complete, combinations rank as an engineer would rank them."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from markupsafe import escape

import armscope
from arm_io import InputError
from arm_model import Arm, GearStage, Joint
from arm_model.effects import CATALOGUE, Instrument
from arm_model.rigid_body.numeric import rigid_torque
from daq.recording import Attachments, write_table
from diagnosis.cause import Cause, Estimate, Signal, Structure
from diagnosis.origins import JUDGEMENT, Evidence, evidence_of, read_table, suspects
from diagnosis.origins.evidence import Finding
from diagnosis.origins.ranking import likelihood, ranking
from diagnosis.origins.table import EFFECT, PATH
from diagnosis.report.html import report
from diagnosis.report.origins import origin_lines, origins_table
from tests.comparison.second_day import motion, puma

TABLE = read_table()
ARM = Arm("six joints", tuple(Joint(gear=50.0) for _ in range(6)))
SEARCHED = frozenset({Instrument.CURRENT, Instrument.RAW, Instrument.LAG})
NAMES = {origin.name: origin for origin in TABLE.origin}


def _cause(
    effect: str, joint: int | None = 2, *, also: tuple[str, ...] = (), confidence: float = 0.95, **values: float
) -> Cause:
    return Cause(
        effect=effect,
        joint=joint,
        parameters=[Estimate(name, value, 0.01 * abs(value), "") for name, value in values.items()],
        confidence=confidence,
        before=2.0,
        after=1.0,
        group=((effect, joint), *((other, joint) for other in also)),
        evidence="",
        felt_at=joint or 1,
        unit="A",
    )


def _order(*causes: Cause, joint: int | None = 2, arm: Arm = ARM) -> list[str]:
    (place,) = [one for one in evidence_of(causes, arm, SEARCHED) if one.joint == joint]
    return [one.origin.name for one in ranking(place, TABLE)]


def test_every_effect_has_an_origin_where_it_is_named() -> None:
    for name, effect in CATALOGUE.items():
        if set(effect.observed_by) == {Instrument.IDENTIFICATION}:  # a part of the model, which diagnose never names
            continue
        scopes = {one.scope for one in TABLE.origin if TABLE.present(one, name) > 1.0}
        assert ("joint" if effect.per_joint else "arm") in scopes, f"{name}: a sign of no origin in origins.toml"


def test_every_origin_can_be_supported_checked_and_looked_up() -> None:
    for origin in TABLE.origin:
        effects = {sign.partition(":")[0] for sign in origin.signs}
        assert effects <= set(CATALOGUE), origin.name
        assert effects <= set(origin.signs), f"{origin.name}: a qualifier needs its effect"
        assert origin.scope == "arm" or all(CATALOGUE[effect].per_joint for effect in effects), origin.name
        assert any(TABLE.present(origin, effect) > 1.0 for effect in effects), origin.name
        assert origin.check.endswith(".") and origin.check[0].isupper() and len(origin.check) > 40, origin.name
        assert all(TABLE.sources[key] for key in origin.source), origin.name
    assert {key for origin in TABLE.origin for key in origin.source} == set(TABLE.sources)
    assert (
        TABLE.strengths["never"]
        < TABLE.chance[EFFECT]
        < min(value for word, value in TABLE.strengths.items() if word != "never")
    )


@pytest.mark.parametrize(
    ("old", "new", "complaint"),
    [
        ('prior = "common"', 'prior = "frequent"', "frequent is not explained"),
        ('"whitney1986", "bittencourt2013"', '"somebody"', "somebody is not explained"),
        ("[origin.signs]\nbase_tilt", '[origin.signs]\n"base_tilt:green" = "usual"\nbase_tilt', "green"),
        ('name = "cold_arm"', 'name = "lost_triggers"', "names must differ"),
        ('check = "Put a level', 'checks = "Put a level', "check"),
    ],
)
def test_a_wrong_entry_of_the_table_is_refused(old: str, new: str, complaint: str, tmp_path: Path) -> None:
    text = PATH.read_text(encoding="utf-8")
    assert old in text
    (tmp_path / "origins.toml").write_text(text.replace(old, new, 1), encoding="utf-8")
    with pytest.raises(InputError, match=complaint):
        read_table(tmp_path / "origins.toml")


TOOTHED = _cause("gear_ripple", amplitude=1e-4, order=17.0, phase=0.0)


@pytest.mark.parametrize(
    ("causes", "first"),
    [
        ([_cause("backlash"), TOOTHED, _cause("load_friction")], "worn_gear_stage"),
        ([_cause("backlash"), TOOTHED], "worn_gear_stage"),
        ([_cause("backlash")], "loose_gear_mesh"),
        ([TOOTHED], "tooth_errors"),
        ([_cause("friction_asymmetry"), _cause("friction_drift")], "shaft_seal"),
        ([_cause("viscous_friction", viscous=2.0), _cause("friction_drift")], "cold_lubricant"),
        (
            [_cause("torque_constant", also=("current_gain",), error=0.1), _cause("current_offset")],
            "current_transducer",
        ),
        ([_cause("current_offset", also=("friction_asymmetry",))], "zero_of_channel"),
        ([_cause("torque_constant", error=-0.1)], "weak_magnets"),
        ([_cause("mains_hum")], "shield_of_channel"),
        ([_cause("gravity_spring")], "taut_cable"),
        ([_cause("encoder_ripple", amplitude=1e-4, order=1.0)], "eccentric_disc"),
        ([_cause("encoder_ripple", amplitude=1e-4, order=2.0)], "unbalanced_sines"),
        ([_cause("cogging", amplitude=0.5, pole_pairs=2.0)], "commutation"),
        ([_cause("cogging", amplitude=0.5, pole_pairs=14.0)], "cogging_motor"),
        ([_cause("gear_ripple", amplitude=1e-4, order=1 / 50.0)], "eccentric_wheel"),
        ([_cause("gear_ripple", amplitude=1e-4, order=2.0), _cause("joint_compliance")], "strain_wave_gear"),
        ([_cause("stribeck_friction"), _cause("coulomb_friction", coulomb=1.0)], "lack_of_lubricant"),
        ([_cause("link_sag"), _cause("joint_compliance")], "elastic_link"),
    ],
)
def test_combinations_rank_as_they_must(causes: list[Cause], first: str) -> None:
    assert _order(*causes)[0] == first


def test_a_worn_wheel_is_more_likely_with_each_of_its_signs() -> None:
    named = [_cause("backlash"), TOOTHED, _cause("load_friction")]
    values = []
    for count in (1, 2, 3):
        (place,) = evidence_of(named[:count], ARM, SEARCHED)
        values.append(likelihood(NAMES["worn_gear_stage"], place, TABLE))
    assert values == sorted(values) and values[0] < 0.5 < 0.9 < values[2]


@pytest.mark.parametrize(
    ("causes", "first"),
    [
        ([_cause("mains_hum", None)], "rig_earth"),
        ([_cause("payload", None)], "tool_changed"),
        ([_cause("time_skew", None, delay=1e-3)], "clock_of_device"),
        ([_cause("dropped_trigger", None)], "lost_triggers"),
        ([_cause("joint_zero_offset", joint, offset=0.01) for joint in (1, 2, 3, 5)], "referencing_of_arm"),
        ([_cause("viscous_friction", joint, viscous=2.0) for joint in (1, 2, 3)], "cold_arm"),
    ],
)
def test_what_several_joints_share_has_an_origin_of_the_arm(causes: list[Cause], first: str) -> None:
    assert _order(*causes, joint=None)[0] == first


def test_one_cause_that_several_joints_show_is_one_finding_of_the_arm() -> None:
    """Currents of all joints with the mains in them are one cause, which no joint has for itself."""
    amplitude = [Estimate("amplitude", 0.1, 0.001, "A")]
    hum = replace(_cause("mains_hum", None), of_joints=dict.fromkeys(range(1, 7), amplitude))
    (place,) = evidence_of([hum], ARM, SEARCHED)
    assert place.joint is None and [one.effects for one in place.findings] == [("mains_hum",)]
    assert "several" in place.findings[0].holds


def test_one_joint_alone_gives_no_origin_of_the_arm() -> None:
    places = evidence_of([_cause("viscous_friction", viscous=2.0)], ARM, SEARCHED)
    assert [one.joint for one in places] == [2]


def test_contradicted_origins_sink() -> None:
    backlash, friction = _cause("backlash"), _cause("load_friction")
    alone, with_it = _order(backlash), _order(backlash, friction)
    assert alone.index("loose_gear_mesh") < alone.index("worn_gear_stage")
    assert with_it.index("worn_gear_stage") < with_it.index("loose_gear_mesh")
    (place,) = evidence_of([backlash, friction], ARM, SEARCHED)
    assert likelihood(NAMES["loose_gear_mesh"], place, TABLE) < 0.2
    # a zero that differs between recordings was not set wrong once
    zero = _cause("joint_zero_offset", offset=0.01)
    moved = replace(zero, of_recordings={"a": zero.parameters, "b": zero.parameters})
    assert _order(zero)[0] == "zero_of_joint" and _order(moved)[0] == "slipped_encoder"


def test_what_could_not_be_seen_is_not_missing() -> None:
    causes = [_cause("backlash")]
    (seen,) = evidence_of(causes, ARM, SEARCHED)
    (hidden,) = evidence_of(causes, ARM, SEARCHED, {("gear_ripple", 2), ("load_friction", 2)})
    (blind,) = evidence_of(causes, ARM, {Instrument.TRACKER})
    worn = NAMES["worn_gear_stage"]
    assert likelihood(worn, seen, TABLE) < likelihood(worn, hidden, TABLE)
    assert "gear_ripple" in seen.absent and not {"gear_ripple", "load_friction"} & hidden.absent
    assert not blind.absent & {"gear_ripple", "load_friction", "coulomb_friction"}


def test_orders_are_those_of_the_teeth_where_the_model_has_them() -> None:
    """Two stages of 10 and 5 with wheels of 40 and 61 teeth: 4 and 1.22 engagements per turn of the motor."""
    geared = Joint(gear=50.0, gear_stage=(GearStage(ratio=10.0, teeth=40), GearStage(ratio=5.0, teeth=61)))
    arm = replace(ARM, joints=tuple(geared for _ in ARM.joints))
    held = {}
    for order in (4.0, 61 / 50, 17.0, 1 / 10):
        (place,) = evidence_of([_cause("gear_ripple", amplitude=1e-4, order=order)], arm, SEARCHED)
        held[order] = place.findings[0].holds
    assert "tooth_order" in held[4.0] and "tooth_order" in held[61 / 50] and "tooth_order" not in held[17.0]
    assert "first_order" in held[1 / 10]


def test_a_member_at_another_joint_weakens_the_evidence() -> None:
    own = _cause("link_inertia")
    elsewhere = replace(own, group=(*own.group, ("payload", None)))
    values = [
        likelihood(NAMES["part_on_link"], evidence_of([one], ARM, SEARCHED)[-1], TABLE) for one in (own, elsewhere)
    ]
    assert values[1] < values[0]


def test_what_may_as_well_be_of_the_whole_arm_has_origins_there() -> None:
    """The zero offset of a planar arm's first joint may be a base that is not level: a level decides."""
    offset = _cause("joint_zero_offset", 1, offset=0.1)
    either = replace(offset, group=(*offset.group, ("base_tilt", None)))
    assert not [one for one in suspects(evidence_of([offset], ARM, SEARCHED)) if one.joint is None]
    (base,) = (one for one in suspects(evidence_of([either], ARM, SEARCHED)) if one.joint is None)
    assert base.origin.name == "tilted_base" and base.supported_by == ("base_tilt",)
    (alone,) = suspects(evidence_of([_cause("base_tilt", None, pitch=0.1)], ARM, SEARCHED))
    assert base.likelihood < alone.likelihood


JOINTED = sorted(name for name, effect in CATALOGUE.items() if effect.per_joint)
FINDINGS = st.lists(
    st.builds(
        Finding,
        effects=st.lists(st.sampled_from(JOINTED), min_size=1, max_size=3, unique=True).map(tuple),
        elsewhere=st.integers(0, 2),
        confidence=st.floats(0.0, 0.98),
        holds=st.frozensets(st.sampled_from(sorted(TABLE.qualifiers)), max_size=2),
    ),
    max_size=5,
)
ORIGINS = st.sampled_from([one for one in TABLE.origin if one.scope == "joint"])


@settings(max_examples=60)
@given(findings=FINDINGS, absent=st.frozensets(st.sampled_from(JOINTED)), origin=ORIGINS, data=st.data())
def test_supporting_evidence_never_lowers_an_origin(findings, absent, origin, data) -> None:
    supporting = data.draw(st.sampled_from([s for s in sorted(origin.signs) if TABLE.present(origin, s) > 1.0]))
    effect, _, qualifier = supporting.partition(":")
    if TABLE.present(origin, effect) < 1.0:
        return
    place = Evidence(joint=1, findings=tuple(findings), absent=absent)
    more = Finding(effects=(effect,), elsewhere=0, confidence=0.9, holds=frozenset({qualifier} if qualifier else ()))
    added = replace(place, findings=(*place.findings, more), absent=absent - {effect})
    before, after = likelihood(origin, place, TABLE), likelihood(origin, added, TABLE)
    assert 0.0 <= before <= after <= 1.0
    surer = replace(added, findings=(*place.findings, replace(more, confidence=0.98)))
    assert likelihood(origin, surer, TABLE) >= after


@settings(max_examples=60)
@given(findings=FINDINGS, data=st.data())
def test_the_order_of_causes_is_irrelevant(findings, data) -> None:
    mixed = data.draw(st.permutations(findings))
    one, other = (
        [
            (s.origin.name, round(s.likelihood, 9))
            for s in ranking(Evidence(joint=3, findings=tuple(f), absent=frozenset()), TABLE)
        ]
        for f in (findings, mixed)
    )
    assert sorted(one) == sorted(other)


def test_an_origin_that_is_hardly_likely_is_not_printed() -> None:
    row = {"joint": 2, "supported_by": ["backlash"], "contradicted_by": [], "missing": [], "check": "turn it by hand"}
    rows = [row | {"title": "worn wheel", "likelihood": 0.1}, row | {"title": "loose key", "likelihood": 0.09}]
    printed = "\n".join(origin_lines({"origins": rows, "origins_are": "judgement"}))
    assert "worn wheel" in printed and "loose key" not in printed
    assert origin_lines({"origins": rows[1:], "origins_are": "judgement"}) == []


def test_no_cause_gives_no_origin() -> None:
    assert evidence_of([], ARM, SEARCHED) == [] and suspects([]) == []


def _recorded(path: Path, arm: Arm, seed: int) -> Path:
    """14 s of two Puma joints; the transducer of joint 2 reads 12 % too much, and 150 mA beside it."""
    rng, t = np.random.default_rng(seed), np.arange(3500) / 250.0
    q, qd, qdd = motion(t, 2, seed, 0.8)
    torque = rigid_torque(arm, q, qd, qdd)
    for j, joint in enumerate(arm.joints):
        v = qd[:, j]
        dry, wet = (np.where(v > 0, *pair) for pair in (joint.coulomb, joint.viscous))
        torque[:, j] += joint.ratio * dry * v / np.hypot(v, joint.sign_velocity)
        torque[:, j] += joint.ratio**2 * (wet * v + joint.rotor_inertia * qdd[:, j])
    i = torque / arm.joint_array("drive_constant")
    i[:, 1] = 1.12 * i[:, 1] + 0.15
    write_table(path, t, {"q": np.round(q / 1e-5) * 1e-5, "i": i + 0.02 * rng.standard_normal(q.shape)}, Attachments())
    return path


def test_two_effects_of_one_joint_lead_to_their_common_origin(tmp_path: Path, root: Path) -> None:
    arm = puma(root, 2)
    runs = [_recorded(tmp_path / f"{seed}.mcap", arm, seed) for seed in (1, 2, 3)]
    result = armscope.diagnose(runs[:2], arm, held_out=runs[2])
    assert {cause.key for cause in result.causes} == {("current_gain", 2), ("current_offset", 2)}
    first = result.origins[0]
    assert (first.origin.name, first.joint) == ("current_transducer", 2) and first.likelihood > 0.5
    assert set(first.supported_by) == {"current_gain", "current_offset"}

    table = json.loads(json.dumps(result.to_json()))
    assert table["origins"][0]["check"] == first.origin.check and table["origins"][0]["source"] == list(first.sources)
    assert all(one["origins"][0]["origin"] == "current_transducer" for one in table["causes"])
    printed, page = str(result), report(result.details, table, result.held_out).html()
    assert first.origin.check in printed
    assert escape(first.origin.check) in page and escape(first.sources[0]) in page
    assert JUDGEMENT in printed and JUDGEMENT[1:] in page and table["origins_are"] == JUDGEMENT

    structure = Structure(Signal.CURRENT, 2, "position", 0.3)
    assert replace(result.details, unexplained=[structure]).origins == []
    assert replace(result.details, unexplained=[replace(structure, joint=1)]).origins == result.origins
    assert replace(result.details, causes=[]).origins == []
    assert "object at 0x" not in page and len(page) < 3e6
    assert "Where to look first" in page and origins_table(table | {"origins": []}) is None
