"""A MuJoCo model as its own compiler leaves it, written plainly: no frames, replicas, attachments, defaults or geoms.

MuJoCo itself (``pip install 'armscope[mujoco]'``) is asked for what is not read here. Its writer of XML keeps frames,
and six digits of each number; the compiled model has every body in its parent and all digits.
"""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any
from xml.sax.saxutils import quoteattr

import numpy as np

from arm_io import InputError
from arm_model.mjcf.tree import FLAGS, NeedsCompiler

_TYPES = ("free", "ball", "slide", "hinge")
"""By MuJoCo's numbers, mjtJoint."""
_EQUALITIES = (("connect", "body"), ("weld", "body"), ("joint", "joint"), ("tendon", "tendon"))
"""By MuJoCo's numbers, mjtEq: tag, and what it is between."""
_SITE = 6
"""MuJoCo's number of sites, mjtObj."""
_DRIVES_JOINT = (0, 1)
"""By MuJoCo's numbers, mjtTrn: in the frame of the joint or of its parent."""


def compiled_text(path: Path, needed: NeedsCompiler, content: bytes | None) -> bytes:
    """The model in a file as MJCF with bodies, inertials and joints alone; angles in radian, masses as compiled.

    ``content``: of the file, where there is none.
    InputError where MuJoCo is not installed, or refuses the file.
    """
    try:
        import mujoco
    except ImportError:
        advice = "which MuJoCo's own compiler reads: pip install 'armscope[mujoco]'"
        raise InputError(path, f"{needed.what}, {advice}") from None
    try:
        with warnings.catch_warnings():
            # attributes that a later MuJoCo will refuse; it would write of them to MUJOCO_LOG.TXT in the working folder
            warnings.simplefilter("ignore")
            mujoco.set_mju_user_warning(lambda _: None)
            if content is None:
                model = mujoco.MjModel.from_xml_path(str(path))
            else:
                model = mujoco.MjModel.from_xml_string(content.decode())
    except ValueError as error:
        raise InputError(path, f"MuJoCo cannot compile it: {' '.join(str(error).split())}") from None
    finally:
        mujoco.set_mju_user_warning(None)
    name = model.names.split(b"\0")[0].decode()
    gravity = _numbers(model.opt.gravity)
    return (
        f'<mujoco model={quoteattr(name)}><compiler angle="radian" autolimits="true"/><option gravity="{gravity}">'
        f"{_flags(model, mujoco.mjtDisableBit)}</option>"
        f"<worldbody>{''.join(_body(model, one) for one in _children(model, 0))}</worldbody>"
        f"<actuator>{''.join(_motor(model, one) for one in range(model.nu))}</actuator>"
        f"<equality>{''.join(_equality(model, one) for one in range(model.neq))}</equality></mujoco>"
    ).encode()


def _motor(model: Any, actuator: int) -> str:
    """An actuator that drives a joint; of others nothing."""
    kind, driven = model.actuator_trntype[actuator], model.actuator_trnid[actuator, 0]
    return f"<motor joint={quoteattr(model.joint(driven).name)}/>" if kind in _DRIVES_JOINT else ""


def _children(model: Any, body: int) -> list[int]:
    return [one for one in range(1, model.nbody) if model.body_parentid[one] == body]


def _body(model: Any, body: int) -> str:
    """A body with its joints and inertial, and what hangs on it."""
    name = quoteattr(model.body(body).name)
    inertial = ""
    if model.body_mass[body] > 0:
        inertial = (
            f'<inertial mass="{_numbers(model.body_mass[body])}" pos="{_numbers(model.body_ipos[body])}" '
            f'quat="{_numbers(model.body_iquat[body])}" diaginertia="{_numbers(model.body_inertia[body])}"/>'
        )
    first = model.body_jntadr[body]
    joints = "".join(_joint(model, first + k) for k in range(model.body_jntnum[body]))
    inside = "".join(_body(model, one) for one in _children(model, body))
    gravcomp = _numbers(model.body_gravcomp[body])
    place = f'gravcomp="{gravcomp}" pos="{_numbers(model.body_pos[body])}" quat="{_numbers(model.body_quat[body])}"'
    return f"<body name={name} {place}>{inertial}{joints}{inside}</body>"


def _joint(model: Any, joint: int) -> str:
    kind = _TYPES[model.jnt_type[joint]]
    name = quoteattr(model.joint(joint).name)
    if kind == "free":
        return f"<freejoint name={name}/>"
    dof = model.jnt_dofadr[joint]
    given = {
        "type": kind,
        "axis": _numbers(model.jnt_axis[joint]),
        "pos": _numbers(model.jnt_pos[joint]),
        "ref": _numbers(model.qpos0[model.jnt_qposadr[joint]]),
        "stiffness": _polynomial(model, "jnt_stiffness", joint),
        "damping": _polynomial(model, "dof_damping", dof),
        "frictionloss": _numbers(model.dof_frictionloss[dof]),
        "armature": _numbers(model.dof_armature[dof]),
    }
    if model.jnt_limited[joint]:
        given["range"] = _numbers(model.jnt_range[joint])
    if model.jnt_actfrclimited[joint]:
        given["actuatorfrcrange"] = _numbers(model.jnt_actfrcrange[joint])
    return f"<joint name={name} {' '.join(f'{key}={quoteattr(value)}' for key, value in given.items())}/>"


def _polynomial(model: Any, name: str, place: int) -> str:
    """Coefficients of a spring or damper: the linear one, and those of higher powers, which MuJoCo has since 4."""
    higher = getattr(model, f"{name}poly", None)
    return _numbers([*np.ravel(getattr(model, name)[place]), *([] if higher is None else higher[place])])


def _equality(model: Any, constraint: int) -> str:
    """A constraint that acts from the beginning, between joints, or bodies by their sites or not; else nothing."""
    kind, ends = model.eq_type[constraint], (model.eq_obj1id[constraint], model.eq_obj2id[constraint])
    if kind >= len(_EQUALITIES) or not model.eq_active0[constraint]:
        return ""
    tag, what = _EQUALITIES[kind]
    if what == "body" and model.eq_objtype[constraint] == _SITE:
        ends = tuple(model.site_bodyid[end] for end in ends)
    named = [getattr(model, what)(end).name for end in ends if end >= 0]
    return f"<{tag} {' '.join(f'{what}{place}={quoteattr(name)}' for place, name in enumerate(named, 1))}/>"


def _flags(model: Any, bits: Any) -> str:
    """What the model disables, of what is read; ``bits``: MuJoCo's mjtDisableBit."""
    off = [one for one in FLAGS if int(model.opt.disableflags) & int(getattr(bits, f"mjDSBL_{one.upper()}", 0))]
    return "<flag " + " ".join(f'{name}="disable"' for name in off) + "/>"


def _numbers(values: Any) -> str:
    """Numbers that read back as the same float64."""
    return " ".join(repr(float(value)) for value in np.ravel(values))
