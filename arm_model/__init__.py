"""What an arm is: kinematics, dynamics, effects; and its simulation, fast."""

from arm_model.description import Arm, Coupling, EffectTerm, Joint
from arm_model.model_file import arm_of, carried_arm, on_fixed_base, read_model, write_model
from arm_model.motion import Motion
from arm_model.parameters import parameter, with_parameters
from arm_model.tables.controller import Controller
from arm_model.tables.drive import FrictionCurve, GearStage
from arm_model.tables.fields import Pose

__all__ = [
    "Arm",
    "Controller",
    "Coupling",
    "EffectTerm",
    "FrictionCurve",
    "GearStage",
    "Joint",
    "Motion",
    "Pose",
    "arm_of",
    "carried_arm",
    "on_fixed_base",
    "parameter",
    "read_model",
    "with_parameters",
    "write_model",
]
