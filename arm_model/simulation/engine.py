"""Compiles generated systems, keeps the machine code, and runs it on all cores.

Machine code is kept in the user's cache folder (ARMSCOPE_CACHE, else XDG_CACHE_HOME/armscope, else ~/.cache/armscope)
under a hash of everything that it depends on: the system's tape, this package's generator, llvmlite and the processor.
It may be deleted at any time. No compiler and no compiler's run-time library are needed on the machine.
"""

from __future__ import annotations

import ctypes
import hashlib
import os
import tempfile
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from arm_io.types import Array
from arm_model.simulation.kernel_layout import layout_of
from arm_model.symbolic.tape import Expr, needed
from arm_model.system.closed_loop_system import System

LANES = 8
"""Parameter sets per vector: one AVX-512 register, two of AVX2."""

_POINTER = ctypes.c_void_p
_SIGNATURE = ctypes.CFUNCTYPE(
    None, ctypes.c_int64, ctypes.c_int64, *[_POINTER] * 6, ctypes.c_int64, ctypes.c_int64, *[_POINTER] * 3
)


@dataclass(frozen=True)
class Program:
    """Compiled code of one system: ``run`` releases the interpreter lock while it runs."""

    system: System
    params: tuple[Expr, ...]
    width: int
    run: Any
    engine: Any  # owns the machine code


def cache_folder() -> Path:
    """Where machine code is kept; made if need be. A temporary folder where nothing of the user's can be written."""
    place = os.environ.get("ARMSCOPE_CACHE")
    root = Path(place) if place else Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache")) / "armscope"
    try:
        root.mkdir(parents=True, exist_ok=True)
    except OSError:
        root = (
            Path(tempfile.gettempdir())
            / f"armscope-{os.getuid() if hasattr(os, 'getuid') else os.environ.get('USERNAME', '')}"
        )
        root.mkdir(mode=0o700, exist_ok=True)
    return root


@cache
def _generator() -> bytes:
    """Hash of the source that makes code from tapes."""
    here = Path(__file__).parent
    return hashlib.sha256(b"".join((here / name).read_bytes() for name in ("codegen.py", "kernel.py"))).digest()


@cache
def target() -> tuple[Any, Any, str]:
    """llvmlite's binding, a target machine for this processor, and what identifies it."""
    import llvmlite
    import llvmlite.binding as llvm

    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    features = llvm.get_host_cpu_features().flatten()
    if "+avx512f" in features:
        features += ",-prefer-256-bit"
    name = llvm.get_host_cpu_name()
    target = llvm.Target.from_default_triple()
    machine = target.create_target_machine(cpu=name, features=features, opt=2, jit=True)
    return llvm, machine, f"{llvmlite.__version__} {name} {features}"


def _key(system: System, params: tuple[Expr, ...], width: int) -> str:
    tape = system.tape
    roots = (*system.rates, *system.next_memories, *system.commands)
    text = [
        target()[2],
        str(width),
        repr([(index, tape.nodes[index]) for index in needed(tape, roots)]),
        repr([[expr.index for expr in part] for part in (system.rates, system.next_memories, system.commands, params)]),
        repr((system.states, system.memories)),
    ]
    return hashlib.sha256(_generator() + "\0".join(text).encode()).hexdigest()


def program_of(system: System, width: int) -> Program:
    """The compiled code of a system, from the cache folder, or generated and compiled now."""
    params = layout_of(system)
    key = _key(system, params, width)
    code = _kept(key) or _compiled(system, params, width, key)
    llvm = target()[0]
    engine = llvm.create_mcjit_compiler(llvm.parse_assembly(""), machine_for_engine())
    engine.add_object_file(llvm.ObjectFileRef.from_data(code))
    engine.finalize_object()
    return Program(system, params, width, _SIGNATURE(engine.get_function_address("run")), engine)


def machine_for_engine() -> Any:
    """A target machine of its own for an engine, which takes it over."""
    llvm, _, _ = target()
    return llvm.Target.from_default_triple().create_target_machine(jit=True)


def _kept(key: str) -> bytes | None:
    try:
        return (cache_folder() / f"{key}.o").read_bytes()
    except OSError:
        return None


def _compiled(system: System, params: tuple[Expr, ...], width: int, key: str) -> bytes:
    from arm_model.simulation.kernel import module_of

    llvm, machine, _ = target()
    module = llvm.parse_assembly(str(module_of(system, params, width)))
    # The tape is free of common and dead parts already: LLVM's passes double the time and change nothing.
    code: bytes = machine.emit_object(module)
    try:
        handle, temporary = tempfile.mkstemp(dir=cache_folder(), suffix=".part")
        with os.fdopen(handle, "wb") as file:
            file.write(code)
        os.replace(temporary, cache_folder() / f"{key}.o")
    except OSError:
        pass  # a full disk costs the compilation next time, nothing else
    return code


def aligned(*shape: int) -> Array:
    """Zeros on a 64-byte boundary."""
    size = int(np.prod(shape))
    raw = np.zeros(size + 8)
    offset = (-raw.ctypes.data % 64) // 8
    return raw[offset : offset + size].reshape(shape)


@cache
def _workers() -> ThreadPoolExecutor:
    return ThreadPoolExecutor(max_workers=cores(), thread_name_prefix="arm")


def cores() -> int:
    """Processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def run_blocks(
    program: Program,
    timing: Array,
    params: Array,
    states: Array,
    memories: Array,
    currents: Array,
    demands: Array,
    rows: tuple[NDArray[np.int64], Array],
    out: Array,
) -> None:
    """Runs all blocks on all cores.

    Blocks are the leading axis of everything but timing and rows; demands with one block are shared.

    states, memories and currents are advanced in place; out (blocks, rows, states + joints, width) is filled.
    """
    blocks, count = states.shape[0], out.shape[1]
    stride = 0 if demands.shape[0] == 1 else demands[0].size // program.width
    pointers = [array.ctypes.data for array in (timing, params, states, memories, currents, demands)]
    tail = [array.ctypes.data for array in (*rows, out)]

    def part(first: int, last: int) -> None:
        program.run(first, last, *pointers, stride, count, *tail)

    pieces = min(blocks, 4 * cores()) if blocks > 1 else 1
    if pieces == 1:
        part(0, blocks)
        return
    edges = np.linspace(0, blocks, pieces + 1).astype(int)
    list(_workers().map(part, edges[:-1].tolist(), edges[1:].tolist()))
