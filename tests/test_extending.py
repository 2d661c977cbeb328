"""Kinds from outside: the code that docs/extending.md shows, and what goes wrong with others."""

import inspect
import os
import re
import signal
import subprocess
import sys
import time
import types
from concurrent.futures import Future
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner

import jaxnet
from jaxnet.cli import main
from jaxnet.engine.tick import Seen
from jaxnet.kinds import contract
from jaxnet.kinds.defences import Neighbourhood
from jaxnet.kinds.detectors import JudgedMessages
from jaxnet.kinds.losses import Messages
from jaxnet.kinds.noises import ChannelNoise
from jaxnet.kinds.observers import HeardMessages
from jaxnet.lanes.jobs import job
from jaxnet.lanes.uniforms import Keyed
from jaxnet.outside import provenance
from jaxnet.outside.families import FAMILIES, base_of
from jaxnet.runs import cluster
from jaxnet.view import page
from tests.systems import of_slots

ROOT = Path(__file__).parents[1]
BLOCK = re.compile(r"^```(?:python|yaml)\n(.*?)^```", re.M | re.S)


def blocks():
    """Blocks of code of the page, in order: module, study, modules of weights, of a loss and of a
    detector, the script, and its end.
    """
    return BLOCK.findall((ROOT / "docs" / "extending.md").read_text())


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A folder with the page's module and study, and nothing else; its module is nobody else's."""
    module, study, weights, loss, detector, *script = blocks()
    (tmp_path / "my_detectors.py").write_text(detector)
    (tmp_path / "my_losses.py").write_text(loss)
    (tmp_path / "my_weights.py").write_text(weights)
    (tmp_path / "my_kinds.py").write_text(module)
    (tmp_path / "study.yaml").write_text(study)
    (tmp_path / "script.py").write_text("".join(script))
    monkeypatch.setattr(sys, "path", [*sys.path])
    yield tmp_path
    sys.modules.pop("my_kinds", None)


def environment():
    """Of a process that a user starts: without what tests are stricter in."""
    strict = ("JAX_NUMPY", "JAX_ENABLE")
    plain = {key: value for key, value in os.environ.items() if not key.startswith(strict)}
    return {**plain, "PYTHONPATH": str(ROOT)}


COMMANDS = """
import sys
from jaxnet.cli import main
from jaxnet.statistics import fits
fits.RESAMPLES = 2  # the intervals are tested elsewhere
for words in sys.argv[1:]:
    main(words.split(), standalone_mode=False)
"""


def process(folder, *words):
    """What a Python that a user starts in a folder prints."""
    done = subprocess.run(
        [sys.executable, *words], cwd=folder, env=environment(), capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_the_page_s_constant_attack_is_the_bias(folder):
    """In every direction."""
    means = []
    for kind in ("my_kinds:Shift", "bias"):
        attack = {"kind": kind, "vehicles": [2], "direction": {"uniform": [0, 6]}}
        results = jaxnet.simulate(jaxnet.load(folder / "study.yaml", {"attack": attack}))
        means.append(results.lanes["tail_mean"].to_numpy())
    assert means[0] == pytest.approx(means[1], rel=1e-12)
    assert means[0].max() > 1


@pytest.mark.long
def test_a_stranger_s_kinds_work_end_to_end(folder):
    """Check, a run killed and resumed on two workers, the nonlinear engine, fit, replay, page."""
    words = ["run", "study.yaml", "samples=400"]
    run = [sys.executable, "-m", "jaxnet", *words]
    with subprocess.Popen(run, cwd=folder, env=environment(), stderr=subprocess.DEVNULL) as killed:
        deadline = time.monotonic() + 300
        while not list(folder.glob("results/study/lanes/*.parquet")) and killed.poll() is None:
            assert time.monotonic() < deadline
            time.sleep(0.02)
        killed.send_signal(signal.SIGKILL)
    there = len(list(folder.glob("results/study/lanes/*.parquet")))
    assert 0 < there < 4, "killed in the middle"
    process(folder, "-m", "jaxnet", *words, "--workers", "2")

    results = jaxnet.open(folder / "results" / "study")
    lanes = results.lanes
    assert len(lanes) == 4 * 400
    assert (lanes["status"] == "ok").all()
    assert (lanes["peak_speed"] > 1).all()
    assert "peak_speed_mean" in results.cells
    assert set(lanes["defence"]) == {"trusted_trim", "Nearest"}

    nonlinear = "run study.yaml engine=nonlinear --out results/nonlinear"
    again = "replay results/study --cell 2 --sample 7 --config study.yaml"
    said = process(
        folder, "-c", COMMANDS, "check study.yaml", nonlinear, "fit results/study", again
    )
    assert "Fading on 2 in what they transmit" in said
    assert "Nearest may drop any source, so there is no bound" in said
    assert "slope s of error = s ā over the tail" in said
    assert "the same as the stored row" in said
    ours = jaxnet.open(folder / "results" / "nonlinear").lanes
    np.testing.assert_allclose(
        ours["tail_mean"], lanes[lanes["sample"] < 6]["tail_mean"], atol=1e-5
    )

    bounds = pd.read_csv(folder / "results" / "study" / "bounds.csv")
    assert bounds[bounds["defence"] == "Nearest"]["slope"].isna().all()
    assert bounds[bounds["defence"] == "trusted_trim"]["slope"].notna().any()
    violations = pd.read_csv(folder / "results" / "study" / "violations.csv")
    assert not len(violations)
    assert page.write_page(jaxnet.open(folder / "results" / "study")).stat().st_size > 1e6


@pytest.mark.long
def test_the_page_s_script_runs(folder):
    """Objects handed over in Python; last the vehicle and the networks of the page's end."""
    said = process(folder, "script.py")
    assert "peak_speed" in said
    assert said.endswith("[1.0, 2.0]\n[8, 2]\n")


CELL = """
import jax.numpy as jnp
from jaxnet.kinds.defences import Defence

SIZE = 2.0
TABLE = [1.0, 5.0]

def size(x, power=3):
    return jnp.sin(x) * TABLE[0] * sum((0.1, 0.2, 0.3))

class Mine(Defence):
    def decide(self, own, received, last, memory, around):
        return last | (lambda y: SIZE * size(y))(own), memory

class Other(Defence):
    pass
"""


def made_of(cell, monkeypatch):
    """What `Mine` of a notebook's cell is told to be made of."""
    module = types.ModuleType("notebook_cells")
    exec(cell.replace("\n", "\n__name__ = 'notebook_cells'\n", 1), vars(module))
    monkeypatch.setitem(sys.modules, "notebook_cells", module)
    return provenance.hash_typed_code("notebook_cells", [module.Mine]).sha256


OTHERS = [("jnp.sin", "jnp.cos"), ("2.0", "3.0"), ("SIZE *", "SIZE +"), ("last |", "last &")]
OTHERS += [("5.0", "6.0"), ("=3", "=4"), ("0.2", "0.4")]  # what it does, calls and uses
SAME = [("SIZE = ", "\n\nSIZE = "), ("pass", "moved: int = 3")]  # its place, its neighbours


@pytest.mark.parametrize("change", [*OTHERS, *SAME])
def test_what_a_notebook_changes_of_a_class_makes_it_another_one(change, monkeypatch):
    changed = made_of(CELL.replace(*change), monkeypatch)
    assert (changed == made_of(CELL, monkeypatch)) == (change in SAME)


def test_what_is_typed_into_a_shell_is_not_given_to_workers(monkeypatch):
    """They could not import it, and would wait for ever."""
    made = provenance.Provenance("", "0", None)
    monkeypatch.setattr(cluster, "modules_of", lambda config: {"__main__": made})
    work = types.SimpleNamespace(config=jaxnet.load({}).config)
    never = Future()  # whoever asks it for workers fails
    never.set_exception(AssertionError("workers were called"))
    crew = cluster.Cluster(never, None)
    with pytest.raises(
        cluster.ClusterError, match="no worker can import __main__, which has no file"
    ):
        next(crew(work, [types.SimpleNamespace(number=1)], lambda _: None))


OF_BROKEN = """
import sys

import jax.numpy as jnp
import numpy as np

from jaxnet.kinds.announcements import Announcement
from jaxnet.kinds.attacks import Attack, constant_basis
from jaxnet.kinds.defences import Defence
from jaxnet.kinds.detectors import Detector
from jaxnet.kinds.graphs import Graph
from jaxnet.kinds.laws import Law
from jaxnet.kinds.losses import Loss
from jaxnet.kinds.metrics import Metric
from jaxnet.kinds.navigators.lissajous import Lissajous
from jaxnet.kinds.noises import ChannelNoise
from jaxnet.kinds.sensors import Sensor
from jaxnet.kinds.vehicles import Vehicle
from jaxnet.kinds.vehicles.single_integrator import SingleIntegrator

"""
VECTORS = """def vectors(self):
        return np.array([1.0, 0.0]).reshape(2, 1, 1, 1)
    def sizes(self, horizon):
        return np.ones((4, 1))"""
MORE = {  # what a class needs besides its broken method
    **dict.fromkeys(("Underived", "Oversized", "Shapeless"), VECTORS),
    "MemoryOfLoss": "def start(self, messages):\n        return jnp.zeros(messages.time.shape)",
    "Aimless": """strategic = True
    def basis(self, time):
        return constant_basis(time)
    def sizes(self, horizon):
        return np.eye(4, 1)""",
}
BREACHES = """
channel={loss: 'broken:ShapeOfLoss'}
Loss.lost(self, messages, memory): jnp.zeros((3,)), memory
ShapeOfLoss.lost gives float64 (3,); expected: booleans (slots = 3, m = 3, lanes = 16)

channel={loss: 'broken:IntegersOfLoss'}
Loss.lost(self, messages, memory): (messages.distance > 1e9).astype(int), memory
IntegersOfLoss.lost gives int64 (3, 3, 16); expected: bool

channel={loss: 'broken:StartOfLoss'}
Loss.start(self, messages): jnp.zeros(2)
StartOfLoss.start gives float64 (2,); expected: arrays whose

channel={loss: 'broken:MemoryOfLoss'}
Loss.lost(self, messages, memory): messages.distance > 1e9, (memory, memory)
MemoryOfLoss.lost gives (float64 (16,), float64 (16,)); expected: a memory as the last one, float64

channel={loss: 'broken:ArgumentsOfLoss'}
Loss.lost(self, messages): messages.distance > 1e9
ArgumentsOfLoss.lost: too many positional arguments; it is

channel={noise: 'broken:FewErrors'}
ChannelNoise.next_errors(self, last, time, interval, sources): last[:1]
FewErrors.next_errors gives (float64 (2, 3, 3, 16)); expected: a tuple of 3

channel={noise: 'broken:NoNumber'}
ChannelNoise.next_errors(self, last, time, interval, sources): [each + jnp.nan for each in last]
NoNumber.next_errors gives a number that is not finite

sensing='broken:Single'
Sensor.errors(self, time, vehicles): [jnp.zeros((2, vehicles, *time.shape), jnp.float32)] * 3
Single.errors gives float32 (2, 3, 16); expected: double prec

detector='broken:AlarmOfVehicles'
Detector.alarms(self, messages, memory): messages.judged.any(axis=0), memory
AlarmOfVehicles.alarms gives bool (3, 16); expected: booleans (s

defence='broken:Restless'
Defence.decide(self, own, received, last, memory, around): last, 1.0
Restless.decide gives 1.0; expected: a memory as the last one, None

law='broken:Slow'
Law.exchange(self, last, demand, heard): demand[0]
Slow.exchange gives float64 (3, 16); expected: double precision (2, m = 3, lanes

vehicle='broken:Lame'
SingleIntegrator.motion(self, state, inputs): inputs[0]
Lame.motion gives float64 (3, 170); expected: double precision (n = 2, m = 3

vehicle='broken:Nameless'
Vehicle.nothing(self): None
vehicle: Nameless: a vehicle gives states and units

navigator='broken:Flat'
Lissajous.jets(self, time): super().jets(time)[:3]
Flat.jets gives float64 (3, 2, 100001); expected: double precision (4, 2

navigator='broken:Skewed'
Lissajous.jets(self, time): (super().jets(time).T * np.array([1.0, 1.0, 2.0, 2.0])).T
Skewed.jets: what stands at order 2 is not the derivative of order 1

navigator='broken:Lost'
Lissajous.jets(self, time): super().jets(time) + np.nan
Lost.jets gives a number that is not finite

attack={announces: 'broken:Mute', vehicles: [2]}; defence={kind: trusted_trim, score: announced}
Announcement.received(self, honest, carried, attacked, signals, time): None
Mute.received gives None; expected: double precision (2, slots = 3, m = 3, lanes

attack={kind: 'broken:Aimless', vehicles: [2]}
Attack.aim(self, seen, memory): seen.errors[0], memory
Aimless.aim gives float64 (2, 3, 16); expected: double precision (2, _, functions = 1, ...)

attack={kind: 'broken:Empty', vehicles: [2]}
Attack.nothing(self): None
Empty: an attack gives

attack={kind: 'broken:Underived', vehicles: [2]}
Attack.basis(self, time): jnp.stack([jnp.sin(time)] * 4)[:, None]
Underived.basis: what stands at order 1 is not the derivative of order 0

attack={kind: 'broken:Oversized', vehicles: [2]}
Attack.basis(self, time): 0.0 * time[None, None] + 5.0 * jnp.eye(4, 1)[:, :, None]
which is over 1

attack={kind: 'broken:Shapeless', vehicles: [2]}
Attack.basis(self, time): jnp.ones((4, 1))
Shapeless.basis must have the shape (4, B, lanes

defence='broken:Dividing'
Defence.decide(self, own, received, last, memory, around): 1 / 0
ZeroDivisionError: division by zero

defence='broken:Flattened'
Defence.decide(self, own, received, last, memory, around): last[0], memory
Flattened.decide: a decision is boolean or double

topology='broken:Negative'
Graph.weights(self, vehicles): -np.ones((vehicles, vehicles + 1))
none of them negative

topology='broken:Apart'
Graph.weights(self, vehicles): np.eye(vehicles, vehicles + 1)[::-1]
the navigator does not reach

topology='broken:WeightsOfText'
Graph.weights(self, vehicles): [['a']]
WeightsOfText: weights must be (3, 4) numbers

topology='broken:Ragged'
Graph.weights(self, vehicles): [[1.0], [1.0, 2.0]]
Ragged: weights must be (3, 4) numbers

topology='broken:Endless'
Graph.weights(self, vehicles): np.full((vehicles, vehicles + 1), np.inf)
Endless: weights must be finite

topology='broken:Leaving'
Graph.weights(self, vehicles): sys.exit(3)
broken.py:24: SystemExit: 3
"""


@pytest.mark.parametrize("case", BREACHES.strip().split("\n\n"))
def test_a_kind_that_breaks_its_contract_is_told_in_a_line(case, tmp_path):
    """The class, the method, what it gives and what is expected; before anything compiles."""
    given, broken, says = case.split("\n")
    (name,) = re.findall(r"broken:(\w+)", given)
    base, method, result = re.fullmatch(r"(\w+)\.(\w+\(.*?\)): (.*)", broken).groups()
    code = f"class {name}({base}):\n    {MORE.get(name, '')}\n"
    code += f"    def {method}:\n        return {result}"
    (tmp_path / "broken.py").write_text(f"{OF_BROKEN}{code}\n")
    assert says in checked(tmp_path, given.split("; "))


ATTACK = "attack={kind: 'broken:Bad', vehicles: [2]}"
NO_KINDS = [  # what a module holds, the key that names it, what is told
    ("", ATTACK, "has no attribute 'Bad'"),
    ("Bad = 3", ATTACK, "is not of the family AnyAttack"),
    ("class Bad(Defence): ...", ATTACK, "is not of the family AnyAttack"),
    (
        'pairs = Metric("pairs", "", lambda seen: seen.error[:, 0, :, None])',
        "metrics=['broken:pairs']",
        "metric pairs.of gives float64 (2, 16, 1); expected: numbers, (m, lanes) = (",
    ),
]


@pytest.mark.parametrize(("code", "given", "says"), NO_KINDS)
def test_what_is_no_kind_is_told_in_a_line(code, given, says, tmp_path):
    (tmp_path / "broken.py").write_text(f"{OF_BROKEN}{code}\n")
    assert says in checked(tmp_path, [given])


def checked(folder, given):
    """The line in which `check` refuses a study beside the module `broken`."""
    lines = ["name: own", "vehicles: 3", "horizon: 0.4", "tail: 0.2", "tick: 0.1", "engine: exact"]
    lines += ["topology: complete", "channel: {noise: {position: 0.1}}"]
    lines += ["attack: {kind: rotating, vehicles: [2]}"]
    (folder / "study.yaml").write_text("\n".join(lines) + "\n")
    done = CliRunner().invoke(main, ["check", str(folder / "study.yaml"), *given])
    assert done.exit_code == 2, done.output
    assert done.stderr.count("\n") == 1, done.stderr
    return done.stderr


NOT_LOADED = {  # what a module and its neighbour hold, and what follows "cannot be imported: "
    "exits": (b"import sys\nsys.exit(0)", b"", "unloadable.py:2: SystemExit: 0"),
    "syntax": (b"\nclass Bad(:", b"", "unloadable.py:2: SyntaxError: invalid syntax"),
    "null byte": (b"\x00", b"", "unloadable.py:1: SyntaxError: source code string cannot"),
    "no module": (b"import nothing_like_this", b"", "unloadable.py:1: ModuleNotFoundError: No"),
    "encoding": (b"x = '\xff'", b"", "unloadable.py:1: SyntaxError: (unicode error)"),
    "neighbour": (b"import beside", b"\n\n)", "beside.py:3: SyntaxError: unmatched ')'"),
    "circle": (
        b"from beside import one",
        b"from unloadable import two",
        "beside.py:1: ImportError: cannot import name 'two' from partially initialized module",
    ),
    "attribute": (b"import beside\nbeside.one", b"", "unloadable.py:2: AttributeError: module"),
    "lines": (b"raise ValueError('one\\ntwo')", b"", "unloadable.py:1: ValueError: one"),
}


@pytest.mark.parametrize("name", NOT_LOADED)
def test_a_module_that_cannot_be_loaded_is_named_in_a_line(name, tmp_path):
    """The file of the user, not one of jaxnet's, and never an end without a word."""
    module, beside, message = NOT_LOADED[name]
    (tmp_path / "unloadable.py").write_bytes(module)
    (tmp_path / "beside.py").write_bytes(beside)
    (tmp_path / "study.yaml").write_text("name: own\nlaw: 'unloadable:Bad'\n")
    done = CliRunner().invoke(main, ["check", str(tmp_path / "study.yaml")])
    assert done.exit_code == 2, done.output
    assert f"unloadable:Bad cannot be imported: {tmp_path}/{message}" in done.stderr
    assert done.stderr.count("\n") == 1, done.stderr


def test_a_noise_that_errs_in_no_order_adds_nothing():
    """`erring` says so; its errors, whatever they are, reach nobody."""

    class Nowhere(ChannelNoise):
        def erring(self):
            return (False, False, False)

        def next_errors(self, last, time, interval, sources):
            return [errors + 0.5 for errors in last]

    keys = {"vehicles": 3, "horizon": 0.1, "tail": 0.1, "attack": "none"}
    keys |= {"channel": {"noise": Nowhere()}}
    scenario = jaxnet.load(keys).cells[0].scenario
    assert job(scenario, Keyed(0), [0]).inputs.lane.noise is None


def test_every_contract_can_be_read():
    """A class from outside is held to these annotations, its arguments to those of the tuples."""
    ours = (each for family in FAMILIES for each in base_of(family).__mro__)
    methods = [
        one for each in ours if each.__module__.startswith("jaxnet.") for one in vars(each).values()
    ]
    read = [contract.hints_of(each) for each in methods if inspect.isfunction(each)]
    assert sum("return" in hints for hints in read) > 100
    assert all(
        map(contract.hints_of, (Seen, Messages, JudgedMessages, HeardMessages, Neighbourhood))
    )


def test_not_a_number_is_a_named_failure(tmp_path, monkeypatch):
    """Weights that are not-a-number, or negative, in some lanes fail these and spoil no other."""
    bad = "jnp.where(around.gain[0] > 1.1, jnp.nan, -1.0)"
    code = "class Bad(Defence):\n    def decide(self, own, received, last, memory, around):\n"
    code += f"        return jnp.where(around.gain[0] < 1.05, around.weights, {bad}), memory\n"
    (tmp_path / "odd_kinds.py").write_text(OF_BROKEN + code)
    monkeypatch.syspath_prepend(tmp_path)
    keys = {"vehicles": 6, "horizon": 2.0, "tail": 1.0, "engine": "exact"}
    keys |= {"defence": "odd_kinds:Bad"}
    gain = [{"uniform": [0.9, 1.2]}, 3, 3]
    lanes = jaxnet.simulate({**keys, "gain": gain, "attack": {"vehicles": [2]}}, samples=40).lanes
    assert set(lanes["status"]) == {"ok", "disconnected"}
    assert lanes.loc[lanes["status"] == "ok", "tail_mean"].notna().all()
    assert lanes.loc[lanes["status"] != "ok", "tail_mean"].isna().all()


def test_a_strangers_loss_decides_which_messages_arrive(folder, monkeypatch):
    """Within 1,000 km everybody hears everybody, within 1 mm nobody hears anybody."""
    monkeypatch.syspath_prepend(folder)
    keys = {"vehicles": 4, "horizon": 1.0, "tail": 0.5, "attack": "none", "engine": "exact"}
    losses = [{"kind": "my_losses:Range", "radius": radius} for radius in (1e6, 1e-3)]
    keys |= {"topology": "complete", "sweep": {"channel.loss": losses}}
    found = jaxnet.simulate(keys, samples=2, progress=False)
    config, counts = found.study.config, found.lanes.groupby("cell")["unheard"]
    ticks = round(config.horizon / config.tick) + 1
    assert counts.unique().map(list).tolist() == [[0], [4 * ticks]]


def test_a_strangers_detector_counts_alarms(folder, monkeypatch):
    """A quarter of honest messages is far off, so a sixteenth of the pairs; the first has none."""
    monkeypatch.syspath_prepend(folder)
    keys = {"engine": "exact", "vehicles": 4, "horizon": 10.0, "attack": "none", "defence": "none"}
    keys |= {"detector": {"kind": "my_detectors:Twice", "threshold": 4 * np.log(2)}}
    lanes = jaxnet.simulate({**keys, "channel": {"noise": {"position": 0.1}}}, samples=20).lanes
    share, pairs = lanes["false_alarms"].mean() * 201 / 200, 20 * 200 * 12
    # Pairs overlap: the variance of their share is p² (1 - p²) + 2 (p³ - p⁴) over their number.
    assert abs(share - 1 / 16) <= 2.576 * np.sqrt((15 / 256 + 2 * (1 / 64 - 1 / 256)) / pairs)
    assert lanes["alarms"].isna().all()


def test_a_strangers_detector_cuts_links(folder, monkeypatch):
    """Every pair of messages alarms, so that all links are cut at the second tick, for 3 ticks."""
    monkeypatch.syspath_prepend(folder)
    cuts = {"kind": "my_detectors:Twice", "threshold": 1e-9, "cuts": "link", "return_after": 0.15}
    keys = {"engine": "exact", "law": "local", "vehicles": 4, "attack": "none", "defence": "none"}
    keys |= {"horizon": 0.4, "tail": 0.4, "output_step": 0.05, "metrics": ["wrongly_cut"]}
    keys |= {"channel": {"noise": {"position": 0.1}}, "detector": cuts}
    lanes = jaxnet.simulate(keys, samples=2).lanes
    assert lanes["wrongly_cut"].tolist() == pytest.approx([6 / 9] * 2)  # of ticks 0 to 8: 1-3, 5-7
    assert lanes["false_alarms"].tolist() == pytest.approx([2 / 5] * 2)  # 1 and 5 of 0, 1, 4, 5, 8


@pytest.mark.long
def test_a_strangers_weights_are_the_ones_in_force(folder, monkeypatch):
    """Errors settle where the system with weights `1/n` of the n retained sources puts them."""
    monkeypatch.syspath_prepend(folder)
    keys = {"vehicles": 7, "topology": {"kind": "lattice", "neighbours": 4}}
    keys |= {"vehicle": "single_integrator"}
    keys |= {"attack": {"kind": "bias", "vehicles": [3, 4], "magnitude": 8.0}, "engine": "exact"}
    keys |= {"horizon": 40.0, "output_step": 1.0, "save": {"trajectories": "all"}}
    keys |= {"defence": "my_weights:Equal"}
    data = jaxnet.simulate(keys, progress=False).trajectories.sel(cell=0, sample=0).isel(time=-1)
    heard = of_slots(data["kept"].values, data["source"].values) > 0
    assert (heard.sum(axis=1) == 4).all()  # of five sources
    W = (heard / 4)[:, 1:]
    settled = np.linalg.solve(np.eye(7) - W, W @ data["attack"].values)
    assert np.abs(settled).max() > 1.0
    np.testing.assert_allclose(
        data["states"].values - data["navigator"].values, settled, rtol=0, atol=1e-9
    )


@pytest.mark.long
def test_kinds_of_installed_packages_and_of_the_script_itself(tmp_path):
    """By an entry point's name, and as a class of `__main__` that a script hands over."""
    module, *_ = blocks()
    (tmp_path / "their_kinds.py").write_text(module)
    info = tmp_path / "their_package-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: their-package\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text("[jaxnet.attacks]\nfading = their_kinds:Fading\n")
    script = module + (
        "\nimport jaxnet\n"
        "keys = {'vehicles': 4, 'horizon': 1.0, 'tail': 0.5, 'engine': 'exact'}\n"
        "keys |= {'defence': Nearest()}\n"
        "attack = {'kind': 'fading', 'vehicles': [2], 'lifetime': 5.0}\n"
        "results = jaxnet.simulate({**keys, 'attack': attack}, samples=2)\n"
        "print(results.study.config.attack.reference(), results.study.config.defence.reference())\n"
        "print(sorted(results.manifest['modules']), (results.lanes['status'] == 'ok').all())\n"
    )
    (tmp_path / "script.py").write_text(script)
    assert process(tmp_path, "script.py").split("\n")[:2] == [
        "fading __main__:Nearest",
        "['__main__', 'their_kinds'] True",
    ]
