"""Loops that the threads of XLA's pool share.

A loop is divided into parts of equal length. The thread that calls the loop and helpers from the pool take
one part after the other until none is left, so that a helper that starts late, or never, delays nothing. The
results do not depend on the number of threads.
"""

from __future__ import annotations

import contextlib
import ctypes
import os
from collections.abc import Iterator

import jax
import llvmlite.binding as llvm
from llvmlite import ir

from jaxsph.core.native.calls import Call, at_offset, loaded_pointer, position_of
from jaxsph.core.native.vectors import INDEX, POINTER, Builder, Value, smaller

NOTHING = ir.VoidType()
PART = ir.FunctionType(NOTHING, [POINTER, INDEX, INDEX])
"""Type of a function that computes a part of a loop, from the call's frame and the part's begin and end."""
TASK = ir.FunctionType(NOTHING, [POINTER])
"""Type of a task for XLA's threads (XLA_FFI_Task)."""

_SIZE = 56
"""Size of the data that the threads share, bytes."""
_NEXT, _DONE, _HOLDERS, _FRAME, _COUNT, _STEP, _PARTS = range(0, _SIZE, 8)
"""Offsets in this data, bytes: the next part, the number of finished parts, the number of threads that still
hold the data, the frame of the call, and the loop's length, the length of a part and the number of parts."""

SPINS = 200
"""Number of times that a thread looks whether the others have finished before it lets other threads run."""
YIELD = "jaxsph_yield"
"""Name of the operating system's function by which a thread lets others run."""


@contextlib.contextmanager
def in_parts(call: Call, count: Value, step: Value) -> Iterator[tuple[Call, Value, Value]]:
    """Loop over the integers below `count`, in parts of `step` integers that several threads compute.

    Yields the writer of a part's code, and the part's begin and end. The parts may be computed in any order,
    and at the same time. If the process has several devices, each uses one thread, and there is one part.
    """
    if jax.local_device_count() > 1:
        yield call, INDEX(0), count
        return
    module = call.builder.module
    name = module.get_unique_name(f"{call.builder.function.name}.part")
    function = _private(module, PART, name)
    frame, begin, end = function.args
    part = Call(ir.IRBuilder(function.append_basic_block()), frame)
    yield part, begin, end
    part.builder.ret_void()
    work = _work(module, function)
    task = _task(module, work)
    _divide(call, function, (work, task), count, step)


def provide_symbols() -> None:
    """Makes the operating system's function `YIELD` known to LLVM."""
    library = ctypes.CDLL(None if os.name == "posix" else "kernel32")
    function = library.sched_yield if os.name == "posix" else library.SwitchToThread
    llvm.add_symbol(YIELD, ctypes.cast(function, ctypes.c_void_p).value)


def _divide(
    call: Call, part: ir.Function, functions: tuple[ir.Function, ir.Function], count: Value, step: Value
) -> None:
    """Computes all parts, with as many helpers as there are threads and parts besides the first.

    `functions`: the work of a thread, and a helper's task.
    """
    b, (work, task) = call.builder, functions
    parts = b.udiv(b.add(count, b.sub(step, INDEX(1))), step)
    others = b.sub(smaller(b, _threads(call), parts), INDEX(1))
    with b.if_else(b.icmp_signed("<", others, INDEX(1))) as (alone, together):
        with alone:
            b.call(part, [call.frame, INDEX(0), count])
        with together:
            shared = b.call(_outside(b.module, "malloc", POINTER, [INDEX]), [INDEX(_SIZE)])
            holders = b.add(others, INDEX(1))
            for offset, value in (
                (_NEXT, INDEX(0)),
                (_DONE, INDEX(0)),
                (_HOLDERS, holders),
                (_FRAME, call.frame),
                (_COUNT, count),
                (_STEP, step),
                (_PARTS, parts),
            ):
                b.store(value, at_offset(b, shared, offset))
            _schedule(call, task, shared, others)
            b.call(work, [shared])
            _wait(b, shared, parts)
            _release(b, shared)


def _threads(call: Call) -> Value:
    """Number of threads in XLA's pool; 1 if there is no pool."""
    b = call.builder
    number = _reserved(b, 8)
    b.store(INDEX(1), number)
    _ask(call, "XLA_FFI_ThreadPool_NumThreads", [number])
    return b.load(number, typ=INDEX)


def _schedule(call: Call, task: ir.Function, shared: Value, number: Value) -> None:
    """Gives XLA's pool a number of helpers' tasks."""
    b = call.builder
    entry, head, body, after = b.block, *(b.function.append_basic_block() for _ in range(3))
    b.branch(head)
    b.position_at_end(head)
    k = b.phi(INDEX)
    k.add_incoming(INDEX(0), entry)
    b.cbranch(b.icmp_signed("<", k, number), body, after)
    b.position_at_end(body)
    refused = _ask(call, "XLA_FFI_ThreadPool_Schedule", [task, shared])
    with b.if_then(refused, likely=False):
        _release(b, shared)
    k.add_incoming(b.add(k, INDEX(1)), b.block)
    b.branch(head)
    b.position_at_end(after)


def _ask(call: Call, function: str, arguments: list[Value]) -> Value:
    """Calls a function of XLA's interface; returns whether it failed."""
    b = call.builder
    size = 8 * (3 + len(arguments))
    given = _reserved(b, size)
    nothing = POINTER(None)
    for k, value in enumerate((INDEX(size), nothing, call.context(), *arguments)):
        b.store(value, at_offset(b, given, 8 * k))
    asked = loaded_pointer(b, call.interface(), position_of(function))
    error = _indirect(b, asked, ir.FunctionType(POINTER, [POINTER]), [given])
    failed = b.icmp_unsigned("!=", error, nothing)
    with b.if_then(failed, likely=False):
        b.store(INDEX(24), at_offset(b, given, 0))
        b.store(error, at_offset(b, given, 16))
        destroy = loaded_pointer(b, call.interface(), position_of("XLA_FFI_Error_Destroy"))
        _indirect(b, destroy, ir.FunctionType(NOTHING, [POINTER]), [given])
    return failed


def _work(module: ir.Module, part: ir.Function) -> ir.Function:
    """Function that computes parts until none is left."""
    function = _private(module, TASK, f"{part.name}.work")
    (shared,) = function.args
    entry, head, body, after = (function.append_basic_block() for _ in range(4))
    b = ir.IRBuilder(entry)
    b.branch(head)
    b.position_at_end(head)
    k = b.atomic_rmw("add", at_offset(b, shared, _NEXT), INDEX(1), "acq_rel")
    frame = loaded_pointer(b, shared, _FRAME)
    count, step, parts = (
        b.load(at_offset(b, shared, offset), typ=INDEX) for offset in (_COUNT, _STEP, _PARTS)
    )
    b.cbranch(b.icmp_signed("<", k, parts), body, after)
    b.position_at_end(body)
    begin = b.mul(k, step)
    b.call(part, [frame, begin, smaller(b, b.add(begin, step), count)])
    b.atomic_rmw("add", at_offset(b, shared, _DONE), INDEX(1), "release")
    b.branch(head)
    b.position_at_end(after)
    b.ret_void()
    return function


def _task(module: ir.Module, work: ir.Function) -> ir.Function:
    """Function that a helper executes."""
    function = _private(module, TASK, f"{work.name}.task")
    b = ir.IRBuilder(function.append_basic_block())
    b.call(work, function.args)
    _release(b, function.args[0])
    b.ret_void()
    return function


def _wait(b: Builder, shared: Value, parts: Value) -> None:
    """Waits until all parts are finished."""
    entry, head, again, after = b.block, *(b.function.append_basic_block() for _ in range(3))
    b.branch(head)
    b.position_at_end(head)
    looks = b.phi(INDEX)
    looks.add_incoming(INDEX(0), entry)
    done = b.load_atomic(at_offset(b, shared, _DONE), "acquire", 8, typ=INDEX)
    b.cbranch(b.icmp_signed("<", done, parts), again, after)
    b.position_at_end(again)
    with b.if_then(b.icmp_signed(">", looks, INDEX(SPINS))):
        b.call(_outside(b.module, YIELD, NOTHING, []), [])
    looks.add_incoming(b.add(looks, INDEX(1)), b.block)
    b.branch(head)
    b.position_at_end(after)


def _release(b: Builder, shared: Value) -> None:
    """Gives up the data that the threads share; the last thread frees it."""
    holders = b.atomic_rmw("sub", at_offset(b, shared, _HOLDERS), INDEX(1), "acq_rel")
    with b.if_then(b.icmp_signed("==", holders, INDEX(1))):
        b.call(_outside(b.module, "free", NOTHING, [POINTER]), [shared])


def _private(module: ir.Module, kind: ir.FunctionType, name: str) -> ir.Function:
    """New function that is not visible outside its module."""
    function = ir.Function(module, kind, name)
    function.linkage = "internal"
    function.attributes.add("noinline")  # a second copy of a loop's code would only be compiled in vain
    return function


def _outside(module: ir.Module, name: str, result: ir.Type, arguments: list[ir.Type]) -> ir.Function:
    """Function of another library."""
    return module.globals.get(name) or ir.Function(module, ir.FunctionType(result, arguments), name)


def _indirect(b: Builder, address: Value, kind: ir.FunctionType, arguments: list[Value]) -> Value:
    """Result of the function at an address."""
    return b.call(_retyped(b, address, ir.PointerType(kind)), arguments)


def _reserved(b: Builder, size: int) -> Value:
    """Address of memory on the stack for numbers and addresses of 8 bytes, `size` bytes in all."""
    writer = ir.IRBuilder(b.function.entry_basic_block)
    writer.position_at_start(b.function.entry_basic_block)
    return _retyped(writer, writer.alloca(INDEX, size // 8), POINTER)


def _retyped(b: Builder, address: Value, kind: ir.Type) -> Value:
    """Address with another type; llvmlite takes a cast between types of addresses for no cast at all."""
    return b.inttoptr(b.ptrtoint(address, INDEX), kind)
