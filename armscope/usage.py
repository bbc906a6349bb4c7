"""Examples of every command, shown at the end of its ``--help``: complete command lines."""

from __future__ import annotations

EXAMPLES: dict[str, tuple[str, ...]] = {
    "init": ("armscope init my_arm --like csv",),
    "doctor": ("armscope doctor config/puma560_sim.toml", "armscope doctor rig.toml --json"),
    "daemon": ("armscope daemon --rig config/puma560_sim.toml",),
    "record": ("armscope record --rig rig.toml --experiment config/experiments/excitation.toml --out fit.mcap",),
    "status": ("armscope status rig.toml",),
    "stop": ("armscope stop rig.toml",),
    "disarm": ("armscope disarm rig.toml",),
    "fetch": ("armscope fetch rig.toml", "armscope fetch rig.toml fit.mcap --out fit.mcap"),
    "page": ("armscope page rig.toml",),
    "replay": ("armscope replay fit.mcap --speed 2",),
    "view": ("armscope view fit.mcap",),
    "info": ("armscope info fit.mcap", "armscope info fit.mcap --verify --json"),
    "recover": ("armscope recover fit.mcap.active --out fit.mcap",),
    "import": ("armscope import table.csv --rig rig.toml --out run.mcap",),
    "export": ("armscope export run.mcap --out table.csv",),
    "plot": (
        "armscope plot measured.mcap simulated.mcap --out currents.png",
        "armscope plot experiment.toml --rig rig.toml --out motion.png",
    ),
    "model": ("armscope model config/models/puma560.toml", "armscope model arm.urdf --out arm.toml"),
    "simulate": (
        "armscope simulate --model model.toml --experiment experiment.toml --out run.mcap",
        "armscope simulate --model model.toml --like measured.mcap --out simulated.mcap",
    ),
    "excite": ("armscope excite --model model.toml --rig rig.toml --out experiment.toml",),
    "identify": ("armscope identify fit.mcap --held-out other.mcap --model model.toml --out identified",),
    "diagnose": ("armscope diagnose --model model.toml --fit a.mcap --held-out b.mcap --out verdict",),
    "compare": (
        "armscope compare monday.mcap friday.mcap --model model.toml",
        "armscope compare --before a1 a2 --after b1 b2 --fail-above 10%",
    ),
    "trend": (
        "armscope trend jan feb mar apr --limit joint3.coulomb=12",
        "armscope trend results --arm puma560 --out trend",
    ),
    "archive": (
        "armscope archive lab --arm puma560 --since 2026-01 --lost 0",
        "armscope archive lab plot joint3.coulomb --out joint3.png",
        "armscope archive lab open feb/diagnosed",
    ),
    "completion": ("armscope completion bash > ~/.local/share/bash-completion/completions/armscope",),
    "calibrate": ("armscope calibrate poses.csv --model model.toml --target 0,0,0.1 --out calibrated",),
    "sim-devices": ("armscope sim-devices config/puma560_can.toml",),
    "demo": ("armscope demo --out demo",),
}
"""Command -> command lines."""


def epilog(name: str) -> str:
    """The examples of a command, each on a line of its own (``\\b`` keeps click from joining them)."""
    return "\b\nexamples:\n" + "\n".join(f"  {line}" for line in EXAMPLES[name])
