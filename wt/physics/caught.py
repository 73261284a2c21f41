"""``mj_step`` for compiled code, whose errors come back to it instead of ending the process.

MuJoCo's errors do not return: a handler of them has to leap back to where MuJoCo was called, as its
Python bindings have theirs do, or the process ends. Neither Python nor Numba can set such a place.
It takes a page of LLVM's language, which the C library of Linux does the leaping for.
"""

from __future__ import annotations

import ctypes
import functools
import threading

import llvmlite.binding as llvm
import mujoco
import numpy as np

from wt.batch import library
from wt.errors import WorkError

_LEAP, _SAID = 512, 1024
"""Bytes that a place to leap to may take (x86-64: 200, ARM64: 312), and those of a message."""
_one_at_a_time = threading.Lock()
_BORROWED = ("_setjmp", "longjmp", "memcpy", "pthread_getspecific", "pthread_setspecific")
_CODE = """
declare i32 @_setjmp(ptr) returns_twice
declare void @longjmp(ptr, i32) noreturn
declare ptr @memcpy(ptr, ptr, i64)
declare ptr @pthread_getspecific(i32)
declare i32 @pthread_setspecific(i32, ptr)

; mj_step, and 0 if it came to its end; each thread has a landing of its own
define i32 @step(ptr %model, ptr %data, ptr %landing) noinline {{
  %set = call i32 @pthread_setspecific(i32 {thread}, ptr %landing)
  %leapt = call i32 @_setjmp(ptr %landing) returns_twice
  %back = icmp ne i32 %leapt, 0
  br i1 %back, label %end, label %go
go:
  %mj_step = inttoptr i64 {mj_step} to ptr
  call void %mj_step(ptr %model, ptr %data)
  br label %end
end:
  %unset = call i32 @pthread_setspecific(i32 {thread}, ptr null)
  ret i32 %leapt
}}

; what else is said, or said elsewhere, is for the handler before
define void @said(ptr %message) {{
  %level = load i32, ptr %message
  %wrong = icmp eq i32 %level, {error}
  %landing = call ptr @pthread_getspecific(i32 {thread})
  %here = icmp ne ptr %landing, null
  %leap = and i1 %wrong, %here
  br i1 %leap, label %away, label %on
away:
  %subject = getelementptr i8, ptr %message, i64 8
  %kept = getelementptr i8, ptr %landing, i64 {leap}
  %copied = call ptr @memcpy(ptr %kept, ptr %subject, i64 {length})
  call void @longjmp(ptr %landing, i32 1) noreturn
  unreachable
on:
  %before = inttoptr i64 {before} to ptr
  call void %before(ptr %message)
  ret void
}}
"""


class Landing:
    """Where a thread's steps leap to when MuJoCo raises an error, and what it says then.

    Attributes:
        address: of it, for :func:`step_address`'s code.
    """

    def __init__(self) -> None:
        """For one thread at a time."""
        self._room = np.zeros(_LEAP + _SAID, dtype=np.uint8)
        self.address = self._room.ctypes.data

    def said(self) -> str:
        """The error."""
        return self._room[_LEAP:].tobytes().partition(b"\0")[0].decode(errors="replace")


def cannot_step(said: str) -> WorkError:
    """What MuJoCo said of a step that came to no end, in one line."""
    return WorkError(f"MuJoCo cannot step this model: {' '.join(said.split())}")


def step_address() -> int:
    """Where the code of ``int step(mjModel*, mjData*, landing)`` begins; not 0 after an error.

    After one the data have to be reset. Until then the machine code of other steps is not touched.

    Raises:
        WorkError: MuJoCo's library is not where its package has it.
    """
    with _one_at_a_time:  # a second one would be in the place of the first, whose code is gone
        return int(_made().get_function_address("step"))


@functools.cache
def _made() -> llvm.ExecutionEngine:
    """The compiled code; it handles what MuJoCo has to say from then on."""
    mujoco_library, c = library(), ctypes.CDLL(None)
    if mujoco_library is None:
        raise WorkError("MuJoCo's library was not found; install it from PyPI: pip install mujoco")
    thread = ctypes.c_uint()
    if c.pthread_key_create(ctypes.byref(thread), None):
        raise WorkError("this process has no room for one more value of each of its threads")
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    for name in _BORROWED:
        llvm.add_symbol(name, _address(c[name]))
    handle = mujoco_library.mju_setLogHandler
    handle.restype, handle.argtypes = ctypes.c_void_p, [ctypes.c_void_p]
    code = _CODE.format(
        thread=thread.value,
        mj_step=_address(mujoco_library.mj_step),
        error=int(mujoco.mjtLogLevel.mjLOG_ERROR),
        before=handle(None),
        leap=_LEAP,
        length=_SAID,
    )
    machine = llvm.Target.from_default_triple().create_target_machine()
    engine = llvm.create_mcjit_compiler(llvm.parse_assembly(code), machine)
    engine.finalize_object()
    handle(engine.get_function_address("said"))
    return engine


def _address(function: ctypes._NamedFuncPointer) -> int:
    address = ctypes.cast(function, ctypes.c_void_p).value
    assert address is not None
    return address
