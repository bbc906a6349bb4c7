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
from arm_model.mjcf.tree import NeedsCompiler

_TYPES = ("free", "ball", "slide", "hinge")
"""By MuJoCo's numbers, mjtJoint."""
_DRIVES_JOINT = (0, 1)
"""By MuJoCo's numbers, mjtTrn: in the frame of the joint or of its parent."""


def compiled_text(path: Path, needed: NeedsCompiler, content: bytes | None = None) -> bytes:
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
        f'<mujoco model={quoteattr(name)}><compiler angle="radian" autolimits="true"/><option gravity="{gravity}"/>'
        f"<worldbody>{''.join(_body(model, one) for one in _children(model, 0))}</worldbody>"
        f"<actuator>{''.join(_motor(model, one) for one in range(model.nu))}</actuator></mujoco>"
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
    place = f'pos="{_numbers(model.body_pos[body])}" quat="{_numbers(model.body_quat[body])}"'
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
        # MuJoCo 4 has the coefficients of a polynomial, of which the first is the linear spring and damper
        "stiffness": _numbers(np.ravel(model.jnt_stiffness[joint])[:1]),
        "damping": _numbers(np.ravel(model.dof_damping[dof])[:1]),
        "frictionloss": _numbers(model.dof_frictionloss[dof]),
        "armature": _numbers(model.dof_armature[dof]),
    }
    if model.jnt_limited[joint]:
        given["range"] = _numbers(model.jnt_range[joint])
    if model.jnt_actfrclimited[joint]:
        given["actuatorfrcrange"] = _numbers(model.jnt_actfrcrange[joint])
    return f"<joint name={name} {' '.join(f'{key}={quoteattr(value)}' for key, value in given.items())}/>"


def _numbers(values: Any) -> str:
    """Numbers that read back as the same float64."""
    return " ".join(repr(float(value)) for value in np.ravel(values))
