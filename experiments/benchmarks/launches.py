"""What does a GPU have to do for a lane? The program is compiled for an H100, and not run.

    python experiments/benchmarks/launches.py [FILE] engine=exact --lanes 1024 131072

The compiler is that of `pip install "jax[cuda12]"`, and needs no GPU. Without it the program is
compiled for the CPU: a stand-in, for fusions differ there, and so do some loops of the engines.

- A launch is an instruction of the compiled program, unless it only names memory (`FREE`).
- A loop of known length is that many passes. Before each pass of another loop, and at each branch,
  the host waits for a flag (`while_thunk.cc` and `conditional_thunk.cc` of XLA). Loops over outputs
  and ticks count by the clock, others as one pass; of branches the longest counts, in `RARE` the
  shortest.
- Kernels share only the device's memory. So a kernel reads each operand once and writes each result
  once: of an operand that is sliced, the slices; of one updated in place, the update. Caches may
  save some of that; random access may cost more.
- Operations are elements of results of arithmetic, a sine counted as one: a lower bound.

A run takes the greatest of launches with flags, bytes, and operations, over what the data sheet
promises. That is an estimate, not measured on a GPU.
"""

import argparse
import os
import re
import sys
from collections.abc import Mapping, Sequence
from typing import NamedTuple

LAUNCH, FLAG = 5e-6, 10e-6  # [s]; a launch takes 4 to 6 µs, a flag is counted as two launches
BANDWIDTH, PEAK = 3.35e12, 34e12  # [bytes/s], [operations/s] in double precision: H100 SXM
H100 = """platform_name: "CUDA" device_description_str: "NVIDIA H100 80GB HBM3"
dnn_version_info { major: 9 minor: 7 } runtime_version { major: 12 minor: 8 } gpu_device_info {
threads_per_block_limit: 1024 threads_per_warp: 32 threads_per_core_limit: 2048 core_count: 132
shared_memory_per_block: 49152 shared_memory_per_core: 233472 shared_memory_per_block_optin: 232448
fpus_per_core: 128 block_dim_limit_x: 2147483647 block_dim_limit_y: 65535 block_dim_limit_z: 65535
memory_bandwidth: 3352320000000 l2_cache_size: 52428800 clock_rate_ghz: 1.98
device_memory_size: 84929347584 registers_per_core_limit: 65536 registers_per_block_limit: 65536
cuda_compute_capability { major: 9 } }"""
FREE = {"parameter", "constant", "tuple", "get-tuple-element", "bitcast", "iota", "copy-done"}
MOVES = {"broadcast", "copy", "concatenate", "transpose", "reshape", "pad", "fusion"}
PARTS = {"slice", "dynamic-slice", "gather"}
UPDATE = {"dynamic-update-slice": 1, "scatter": 2}  # in place; and which operand the update is
RARE = "Propagation.advance", "isolated"  # a vehicle that stands still, and one that is cut off
INSTRUCTION = re.compile(r"\n  (?:ROOT )?%(\S+) = (\(.*?\)|\S+) ([a-z][\w\-]*)\((.*?)\)(.*)")


class Work(NamedTuple):
    """Launches, flags that the host waits for, bytes, operations."""

    launches: int = 0
    flags: int = 0
    moved: int = 0
    operations: int = 0

    def plus(self, other: "Work", times: int = 1) -> "Work":
        return Work(*(a + times * b for a, b in zip(self, other, strict=True)))

    def seconds(self) -> dict[str, float]:
        host = self.launches * LAUNCH + self.flags * FLAG
        return {"launches": host, "bytes": self.moved / BANDWIDTH, "sums": self.operations / PEAK}


class Instruction(NamedTuple):
    """A line of a computation; `rest` has its attributes."""

    name: str
    shape: str
    op: str
    operands: list[str]
    rest: str

    def calls(self, key: str) -> list[str]:
        found = re.search(rf" {key}=\{{?((?:%[\w.\-]+(?:, )?)+)", self.rest)
        return names_in(found[1]) if found else []

    def length(self) -> int | None:
        """Passes of a loop, if the compiler knows them."""
        found = re.search(r'known_trip_count":\{"n":"(\d+)', self.rest)
        return int(found[1]) if found else None


class Program:
    """A compiled program, from its text; `passes` of loops by the function that has them."""

    def __init__(self, text: str, passes: Mapping[str, int] | None = None):
        text, self.passes = re.sub(r"/\*.*?\*/", "", text), passes or {}
        self.computations, self.entry = dict[str, dict[str, Instruction]](), ""
        for entry, name, body in re.findall(r"\n(ENTRY )?%(\S+) \(.*\{((?:\n  .*)*)\n\}", text):
            self.computations[name] = {
                one: Instruction(one, shape, op, names_in(operands), rest)
                for one, shape, op, operands, rest in INSTRUCTION.findall(body)
            }
            self.entry = name if entry else self.entry
        self.all = [each for body in self.computations.values() for each in body.values()]
        self.names = dict(re.findall(r'\n(\d+) "(.*)"', text.partition("\nFunctionNames")[2]))
        self.places = dict(re.findall(r"\n(\d+) \{file_name_id=\d+ function_name_id=(\d+)", text))
        frames = re.findall(r"\n(\d+) \{file_location_id=(\d+)(?: parent_frame_id=(\d+))?", text)
        self.frames = {
            number: (place, str(int(parent or 1) - 1)) for number, place, parent in frames
        }

    def functions(self, each: Instruction) -> list[str]:
        """The function in which an instruction stands, and its caller, as far as they are known."""
        found, frame = list[str](), re.search(r"stack_frame_id=(\d+)", each.rest)
        number = frame[1] if frame else ""
        for _ in range(2):
            place, number = self.frames.get(number, ("", ""))
            found.append(self.names.get(self.places.get(place, ""), ""))
        return found

    def counts(self) -> dict[str, int]:
        """Instructions of some kinds; loops by whether the compiler knows their length."""
        known = [each.length() is not None for each in self.all if each.op == "while"]
        found = {"known loops": sum(known), "other loops": len(known) - sum(known)}
        kinds = "conditional", "sort", "scatter", "custom-call"
        return found | {kind: sum(each.op == kind for each in self.all) for kind in kinds}

    def work(self, computation: str = "") -> Work:
        """The work of one pass through a computation, by default through the program."""
        total, body = Work(), self.computations[computation or self.entry]
        for each in body.values():
            if each.op == "while":
                total = total.plus(self.loop(each))
            elif each.op == "conditional":
                kinds = "branch_computations", "true_computation", "false_computation"
                branches = [self.work(name) for kind in kinds for name in each.calls(kind)]
                rare = any(name in RARE for name in self.functions(each))
                total = total.plus((min if rare else max)(branches)).plus(Work(flags=1))
            elif each.op == "call":
                total = total.plus(self.work(*each.calls("to_apply")))
            elif each.op not in FREE:
                total = total.plus(self.kernel(each, body))
        return total

    def loop(self, loop: Instruction) -> Work:
        inner, test = (self.work(*loop.calls(key)) for key in ("body", "condition"))
        if (length := loop.length()) is not None:
            return Work().plus(inner, length)
        passes = self.passes.get(self.functions(loop)[0], 1)
        return Work().plus(inner, passes).plus(test.plus(Work(flags=1)), passes + 1)

    def kernel(self, each: Instruction, body: Mapping[str, Instruction]) -> Work:
        """One launch. It reads the parameters of the fusion, and writes the last instruction."""
        given = {name: body[name]._replace(op="parameter") for name in each.operands}
        inside = self.computations[each.calls("calls")[0]] if each.op == "fusion" else given
        inside = inside if each.op == "fusion" else {**given, each.name: each}
        read = sum(self.read(one, inside) for one in inside.values() if one.op == "parameter")
        arithmetic = (
            one for one in inside.values() if one.op not in FREE | MOVES | PARTS | {*UPDATE}
        )
        of = (inside[one.operands[0]] if one.op == "reduce" else one for one in arithmetic)
        written = self.written([*inside.values()][-1], inside)
        return Work(1, 0, read + written, sum(size(one.shape)[0] for one in of))

    def read(self, source: Instruction, inside: Mapping[str, Instruction]) -> int:
        """Bytes of a value that a kernel reads."""
        parts, whole = 0, size(source.shape)[1]
        for one in inside.values():
            if source.name in one.operands:
                if one.op == "bitcast":
                    parts += self.read(one, inside)
                elif one.op in PARTS:
                    parts += size(one.shape)[1]
                elif one.op not in UPDATE or one.operands[0] != source.name:
                    parts += whole
        return min(parts, whole)

    def written(self, root: Instruction, inside: Mapping[str, Instruction]) -> int:
        """Bytes of a result that a kernel writes."""
        if root.op in ("tuple", "bitcast"):
            return sum(self.written(inside[name], inside) for name in root.operands)
        part = inside[root.operands[UPDATE[root.op]]] if root.op in UPDATE else root
        return size(part.shape)[1]


def names_in(text: str) -> list[str]:
    return re.findall(r"%([\w.\-]+)", text)


def size(shape: str) -> tuple[int, int]:
    """Elements of a shape, and bytes."""
    elements = stored = 0
    for kind, sides in re.findall(r"([a-z]+\d*)\[([\d,]*)\]", shape):
        number = 1
        for side in filter(None, sides.split(",")):
            number *= int(side)
        elements += number
        stored += number * (int(re.sub(r"\D", "", kind) or 8) // 8)
    return elements, stored


def compiled(study: Sequence[str], lanes: int) -> tuple[Program, int, int]:
    """The program of a study's first cell; lanes of a load, and ticks."""
    import jax
    from jax.experimental import topologies
    from jax.sharding import SingleDeviceSharding

    import jaxnet
    from jaxnet.engine import batch, programs
    from jaxnet.lanes.jobs import job
    from jaxnet.lanes.uniforms import Keyed

    jax.config.update("jax_traceback_in_locations_limit", 10)
    jax.config.update("jax_enable_compilation_cache", False)
    try:
        chip = topologies.get_topology_desc("1x1x1", "cuda", target_config=H100, topology="1x1x1")
        device = chip.devices[0]
    except (NotImplementedError, RuntimeError):
        device = jax.devices("cpu")[0]
    print(f"compiled for {device.device_kind}", file=sys.stderr)
    files = [word for word in study if "=" not in word]
    cell = jaxnet.load(files[0] if files else {}, [word for word in study if "=" in word]).cells[0]
    one = job(cell.scenario, Keyed(0), range(1))
    plan = one.plan._replace(chunk=lanes)
    load = lanes * (1 if plan.save else plan.engine.queue)
    given = one.network, one.clock, batch.queue_of(one.inputs, load), load
    _, structure, shapes = programs.taken_apart(given)
    there = SingleDeviceSharding(device)
    placed = [jax.ShapeDtypeStruct(each.shape, each.dtype, sharding=there) for each in shapes]
    with jax.enable_x64(True), jax.default_device(device):
        text = programs.jitted(plan, structure).lower(*placed).compile().as_text()
    outputs, between = int(one.clock.outputs), int(one.clock.ticks)
    passes = {
        "in_lockstep": outputs + 1,
        "in_lockstep.<locals>.output": between,
        "work_off": load // lanes,
        "work_off.<locals>.until_some_end": outputs * between,
    }
    return Program(text, passes), load, outputs * between


def main() -> None:
    """A line for each number of lanes side by side."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("study", nargs="*", help="a config, and KEY=VALUE")
    parser.add_argument("--lanes", type=int, nargs="+", default=[1024, 16384, 131072])
    given = parser.parse_args()
    os.environ |= {"JAX_SKIP_CUDA_CONSTRAINTS_CHECK": "1", "CUDA_VISIBLE_DEVICES": "-1"}
    print("| lanes | launches a tick | flags | bytes a lane and tick | operations | lanes/s |")
    print("|---|---|---|---|---|---|")
    for lanes in given.lanes:
        program, load, ticks = compiled(given.study, lanes)
        work, passes = program.work(), ticks * load // lanes
        bound, time = max(work.seconds().items(), key=lambda each: each[1])
        host = f"{work.launches / passes:.0f} | {work.flags / passes:.1f}"
        device = f"{work.moved / passes / lanes:,.0f} | {work.operations / passes / lanes:,.0f}"
        print(f"| {lanes:,} | {host} | {device} | {load / time:,.0f}, by {bound} |", flush=True)
        print(", ".join(f"{number} {kind}" for kind, number in program.counts().items()))


if __name__ == "__main__":
    main()
