"""Bad configs: each is refused at its exact place, in words that help; then some tricky good ones.

An arrow → stands just before what is at fault, in a text or in an override; it is taken out before
the config is read. Two arrows, or two keys with a | between, mean that either will do.
"""

import re
import time
from itertools import accumulate
from pathlib import Path
from random import Random
from textwrap import dedent
from typing import Any, NamedTuple

import click.testing
import pytest

import jaxnet
from jaxnet.cli import main
from jaxnet.config import study

ARROW = "→"


class Bad(NamedTuple):
    """A config with one fault: the key to be named, and a part of what is to be said of it."""

    text: str
    key: str
    says: str
    overrides: tuple[str, ...] = ()


def named(bad: Bad) -> Bad:
    """The config with a first line that gives it a name."""
    return bad._replace(text="name: bad\n" + dedent(bad.text))


# --- one key, one value ---------------------------------------------------------------------------

NUMBERS = [
    Bad("→vehicles: 12.0", "vehicles", "must be a whole number (got 12.0)"),
    Bad("→vehicles: true", "vehicles", "must be a whole number (got true)"),
    Bad("→vehicles: twelve", "vehicles", 'must be a whole number (got "twelve")'),
    Bad("→vehicles: 0", "vehicles", "must be at least 1 (got 0)"),
    Bad("→vehicles: .nan", "vehicles", "must be a whole number (got NaN)"),
    Bad("→seed: -1", "seed", "must be at least 0 (got -1)"),
    Bad("→seed: 9223372036854775808", "seed", "(got 9223372036854775808)"),
    Bad("→seed: 0b1", "seed", 'must be a whole number (got "0b1")'),
    Bad("→seed: 1_000", "seed", 'must be a whole number (got "1_000")'),
    Bad("→seed: 1e3", "seed", "must be a whole number (got 1000.0)"),
    Bad("→samples: 0", "samples", "must be at least 1 (got 0)"),
    Bad("→samples: 2.5", "samples", "must be a whole number (got 2.5)"),
    Bad("→samples: many", "samples", 'must be a whole number (got "many")'),
    Bad("→metrics: [alarms]", "metrics", "no word is judged without a detector (got alarms)"),
    Bad("→metrics: [false_alarms, spread]", "metrics", "without a detector (got false_alarms)"),
    Bad("samples: {→until: {of: unrecovered}}", "samples.until.half_width", "required"),
    Bad("samples: {until: {→half_width: 0}}", "samples.until.half_width", "greater than 0 (got 0)"),
    Bad(
        "samples: {until: {half_width: 0.1, →at_mst: 9}}",
        "samples.until.at_mst",
        "did you mean 'at_most'?",
    ),
    Bad(
        "samples: {until: {half_width: 0.1, →of: lost}}",
        "samples.until.of",
        "'unrecovered' (got \"lost\")",
    ),
    Bad(
        "samples: {until: {half_width: 0.1, →confidence: 1}}",
        "samples.until.confidence",
        "less than 1",
    ),
    Bad("samples: {until: {half_width: 0.1}, →untl: 1}", "samples.untl", "did you mean 'until'?"),
    Bad("samples: {→until: {half_width: 0.1}}", "samples.until", "give recovery: {tau: 0.01}"),
    Bad(
        "attack: none\nrecovery: {tau: 0.01}\nsamples: {→until: {half_width: 0.1}}",
        "samples.until",
        "nobody is attacked in any cell",
    ),
    Bad("recovery: {→tau: 0}", "recovery.tau", "must be greater than 0 (got 0)"),
    Bad("recovery: {→ta: 1}", "recovery.ta", "did you mean 'tau'?"),
    Bad("recovery: {→worst: -1}", "recovery.worst", "must be at least 0 (got -1)"),
    Bad(
        "search: {over: {→attack.phase: 3}}",
        "search.over.attack.phase",
        "must be [a, b], each, {each: [a, b]}",
    ),
    Bad(
        "search: {over: {→attack.magnitude: each}}",
        "search.over.attack.magnitude",
        "give the bounds",
    ),
    Bad(
        "search: {over: {→attack.frequency: [4, 0.1]}}",
        "search.over.attack.frequency",
        "lower bound stands first",
    ),
    Bad(
        "search: {over: {→attack.frequenzy: [0, 1]}}",
        "attack.frequenzy",
        "did you mean 'frequency'?",
    ),
    Bad(
        "search: {over: {→attack.vehicles: {choose: 20}}}",
        "attack.vehicles",
        "there are 12 vehicles (got 20)",
    ),
    Bad(
        "search: {over: {attack.phase: each}, →maximise: speed}",
        "search.maximise",
        "one of tail_mean, tail_max",
    ),
    Bad("search: {over: {attack.phase: each}, →budget: 10}", "search.budget", "at least 100 lanes"),
    Bad(
        "search: {over: {attack.phase: each}, →maximise: unrecovered}",
        "search.maximise",
        "give recovery: {tau: 0.01}",
    ),
    Bad(
        "search: {over: {attack.phase: each}}\nsamples: 256\n→draws: sobol",
        "draws",
        "give draws: random",
    ),
    Bad(
        "search: {over: {→attack.frequency: [0, 1]}}\nsweep: {attack.frequency: [1, 2]}",
        "search.over.attack.frequency",
        "attack.frequency is swept",
    ),
    Bad(
        "→recovery: {tau: 0.1}\nattack: {→magnitude: {uniform: [1, 2]}}",
        "recovery|attack.magnitude",
        "compares with ā, which is drawn here",
    ),
    Bad("→horizon: -1", "horizon", "must be greater than 0 (got -1)"),
    Bad("→horizon: .nan", "horizon", "must be finite (got NaN)"),
    Bad("→horizon: .inf", "horizon", "must be finite (got Infinity)"),
    Bad("→horizon: 1e400", "horizon", "must be finite"),
    Bad("→horizon: true", "horizon", "must be a number (got true)"),
    Bad("→horizon: soon", "horizon", 'must be a number (got "soon")'),
    Bad("→horizon: 12:30", "horizon", 'must be a number (got "12:30")'),
    Bad("→horizon: {uniform: [20, 30]}", "horizon", "must be a number, not a distribution (got {"),
    Bad("→horizon:", "horizon", "must be a number (got null)"),
    Bad("→tick: -0.1", "tick", "must be at least 0 (got -0.1)"),
    Bad("→output_step: 0", "output_step", "must be greater than 0 (got 0)"),
    Bad("→tail: -1", "tail", "must be at least 0 (got -1)"),
    Bad("→gain: [1, 3]", "gain", "must be 3, one for each order of two_wheeled (got 2)"),
    Bad("→gain: [1, 3, 3, 3]", "gain", "must be 3, one for each order of two_wheeled (got 4)"),
    Bad("→gain: [1, 5, 9, 9, 5]", "gain", "4 entries (got [1, 5, 9, 9, 5])"),
    Bad("→gain: 3", "gain", "must be a list (got 3)"),
    Bad("gain: {→vehicles: 3}", "gain.vehicles", "must be a list (got 3)"),
    Bad("→tick: {choice: [0.05, 0.1]}", "tick", "must be a number, not a distribution (got {"),
    Bad(
        "→vehicles: {choice: [12]}", "vehicles", "must be a whole number, not a distribution (got {"
    ),
    Bad("gain: [1, →high, 3]", "gain.1", 'must be a number (got "high")'),
    Bad("gain:\n  - 1\n  - 3\n  - →.inf", "gain.2", "must be finite (got Infinity)"),
    Bad("initial: {→position: far}", "initial.position", 'must be a number (got "far")'),
    Bad("initial: {→heading: null}", "initial.heading", "must be a number (got null)"),
    Bad("→initial: fast", "initial", 'must be a mapping (got "fast")'),
]

KINDS = [
    Bad("law: {kind: rounds, →rounds: 0}", "law.rounds", "must be at least 1 (got 0)"),
    Bad("law: {kind: rounds, →round: 2}", "law.round", "did you mean 'rounds'?"),
    Bad("→law: round", "law.kind", "must be one of exact, linearised, local, rounds"),
    Bad(
        "→law: rounds\n→tick: 0", "law|tick", "rounds holds the jerk from tick to tick: give a tick"
    ),
    Bad("→engine: stacked\nlaw: rounds", "engine", "the stacked engine cannot hold a jerk"),
    Bad("→topology: sta", "topology|topology.kind", "did you mean 'star'?"),
    Bad(
        "→topology: ring",
        "topology|topology.kind",
        "one of circulant, complete, cyclic, edges, erdos_renyi, figure1, file, grid, lattice, path,"
        ' random_regular, small_world, star, switching, or module:Class (got "ring")',
    ),
    Bad("→topology: 3", "topology", "(got 3)"),
    Bad("→topology: []", "topology", "(got [])"),
    Bad("→topology:", "topology", "(got null)"),
    Bad(
        """
        topology:
          navigator_weight: 0.1
          →kind: cyclical
        """,
        "topology.kind",
        "did you mean 'cyclic'?",
    ),
    Bad("topology: {→kind: [star]}", "topology.kind", '(got ["star"])'),
    Bad(
        "topology: {→kind: true}",
        "topology.kind",
        "small_world, star, switching, or module:Class (got true)",
    ),
    Bad("topology: {→kind: }", "topology.kind", "(got null)"),
    Bad("topology: {kind: star, →navigator_weight: 0.1}", "topology.navigator_weight", "unknown"),
    Bad("topology: {→navigator_weight: 0}", "topology.navigator_weight", "greater than 0 (got 0)"),
    Bad("topology: {→navigator_weight: 1.1}", "topology.navigator_weight", "at most 1 (got 1.1)"),
    Bad("topology: {→label: 3}", "topology.label", "must be text (got 3)"),
    Bad("→topology: edges", "topology.edges", "required"),
    Bad("topology: {kind: edges, →edges: []}", "topology.edges", "(got [])"),
    Bad("topology: {kind: edges, →edges: 3}", "topology.edges", "must be a list (got 3)"),
    Bad("topology: {kind: edges, edges: [[1, 0, 1]], →label: 3}", "topology.label", "must be text"),
    Bad("topology: {kind: edges, edges: [[1, 0, 1]], →edge: 3}", "topology.edge", "mean 'edges'?"),
    Bad(
        "→navigator: circle",
        "navigator|navigator.kind",
        'one of driven, lissajous, none, or module:Class (got "circle")',
    ),
    Bad("navigator: {→amplitude: 3}", "navigator.amplitude", "must be a list (got 3)"),
    Bad("navigator: {→phase: [0, 0, 0]}", "navigator.phase", "2 entries (got [0, 0, 0])"),
    Bad("navigator: {→amplitud: [9, 9]}", "navigator.amplitud", "did you mean 'amplitude'?"),
    Bad(
        "navigator: {amplitude: [→{uniform: [90, 100]}, 50]}",
        "navigator.amplitude.0",
        "must be a number, not a distribution (got {",
    ),
    Bad("→attack: rotatin", "attack|attack.kind", "did you mean 'rotating'?"),
    Bad("attack: {→magnitude: -1}", "attack.magnitude", "must be at least 0 (got -1)"),
    Bad("attack: {→magnitude: big}", "attack.magnitude", 'must be a number (got "big")'),
    Bad("attack: {→magnitude: true}", "attack.magnitude", "must be a number (got true)"),
    Bad("attack: {→magnitude: .nan}", "attack.magnitude", "must be finite (got NaN)"),
    Bad("attack: {→direction: 3}", "attack.direction", "unknown key"),
    Bad("attack: {kind: bias, →frequency: 3}", "attack.frequency", "unknown key (known here:"),
    Bad("attack:\n  →magnitude: 5\n  kind: none", "attack.magnitude", "unknown key"),
    Bad("attack: {→links: navigater}", "attack.links", "'auto', 'neighbour' or 'navigator' (got"),
    Bad(
        "attack: {→vehicles: 2}",
        "attack.vehicles",
        "must be a list (got 2): {random: 2} draws 2 in each lane, [2] is vehicle 2",
    ),
    Bad(
        "attack: {vehicles: {random: 1, →label: one}}",
        "attack.vehicles.label",
        "unknown key (known here: random)",
    ),
    Bad("attack: {vehicles: [2, →5.0]}", "attack.vehicles.1", "must be a whole number (got 5.0)"),
    Bad("attack: {vehicles: [→true]}", "attack.vehicles.0", "must be a whole number (got true)"),
    Bad(
        "attack: {kind: envelope, →of: {}}",
        "attack.of|attack.of.kind",
        "must be one of bias, chirp, ",
    ),
    Bad(
        "attack: {kind: envelope, →of: 3}",
        "attack.of",
        "must be a mapping, or one of bias, chirp, ",
    ),
    Bad("→attack: envelope", "attack.of", "required"),
    Bad("attack: {kind: envelope, →of: bia}", "attack.of", "did you mean 'bias'?"),
    Bad(
        "topology: {kind: circulant, →offsets: [9223372036854775808, -4]}",
        "topology.offsets",
        "around 12",
    ),
    Bad(
        "→topology: {navigator_weight: 1e-16}",
        "topology.navigator",
        "less than 1e-15 of the weights",
    ),
    Bad("defence: {kind: w_msr, →F: 9223372036854775808}", "defence.F", "at most 10000"),
    Bad("defence: {kind: ms_norm, →F: 9223372036854775808}", "defence.F", "at most 10000"),
    Bad(
        "defence: {trusted: {→nearest: 9223372036854775808}}",
        "defence.trusted.nearest",
        "at most 10000",
    ),
    Bad(
        "attack: {kind: envelope, of: {kind: bias, →directon: 1}}",
        "attack.of.directon",
        "'direction'?",
    ),
    Bad(
        "→defence: trim",
        "defence|defence.kind",
        'none, trust, trusted_only, trusted_trim, w_msr, or module:Class (got "trim")',
    ),
    Bad("defence: {kind: none, →theta: 1}", "defence.theta", "unknown key"),
    Bad("defence: {→theta: -1}", "defence.theta", "must be at least 0 (got -1)"),
    Bad("defence: {→theta: 1.5}", "defence.theta", "must be a whole number (got 1.5)"),
    Bad(
        "defence: {→theta: {choice: [1, 2]}}", "defence.theta", "a whole number, not a distribution"
    ),
    Bad(
        "engine: {→max_steps: {choice: [9]}}",
        "engine.max_steps",
        "a whole number, not a distribution",
    ),
    Bad("defence: {→theta: [1]}", "defence.theta", "must be a whole number (got [1])"),
    Bad("defence: {theta: {→1: -1}}", "defence.theta.1", "must be at least 0 (got -1)"),
    Bad("defence: {theta: {→one: 1}}", "defence.theta.one", 'must be a whole number (got "one")'),
    Bad(
        "defence: {→theta: {→1.5: 1}}",
        "defence.theta|defence.theta.1.5",
        "must be a whole number (got 1.5)",
    ),
    Bad("defence: {trusted: {→1: 2}}", "defence.trusted.1", "must be a list (got 2)"),
    Bad(
        "defence: {→trusted: [1]}",
        "defence.trusted",
        "must be none, {vehicle: [sources]}, {share: s} or",
    ),
    Bad("defence: {→tolerance: -1e-9}", "defence.tolerance", "must be at least 0 (got -1e-09)"),
    Bad(
        "defence: {→isolated: coast}\n→tick: 0",
        "defence.isolated|tick",
        "coast: a vehicle keeps its drive from tick to tick: give a tick, or fail",
    ),
    Bad(
        "defence: {→isolated: stay}", "defence.isolated", "must be 'fail' or 'coast' (got \"stay\")"
    ),
    Bad(
        "→engine: flt",
        "engine|engine.kind",
        'exact, nonlinear, stacked, or module:Class (got "flt")',
    ),
    Bad("→engine: exat", "engine|engine.kind", "did you mean 'exact'?"),
    Bad("→engine: flat", "engine|engine.kind", "flat was renamed to exact"),
    Bad("attack: {→channel: navigator}", "attack.channel", "channel was renamed to links"),
    Bad("sweep: {→attack.channel: [auto]}", "sweep.attack.channel", "channel was renamed to links"),
    Bad("engine: {→kind: chassis}", "engine.kind", "chassis was renamed to nonlinear"),
    Bad("→engine: exact\ntick: 0", "engine", "the exact engine decides at ticks only: give a tick"),
    Bad(
        "engine: {→solver: tsit5}", "engine.solver", "'gauss', 'dopri5' or 'dopri8' (got \"tsit5\")"
    ),
    Bad("engine: {→rtol: 0}", "engine.rtol", "must be greater than 0 (got 0)"),
    Bad("engine: {→rtol: 1}", "engine.rtol", "must be less than 1 (got 1)"),
    Bad("engine: {→atol: 0.0}", "engine.atol", "must be greater than 0 (got 0.0)"),
    Bad("engine: {→max_steps: 1e5}", "engine.max_steps", "must be a whole number (got 100000.0)"),
    Bad("engine: {→max_step: 9}", "engine.max_step", "did you mean 'max_steps'?"),
]

DISTRIBUTIONS = [
    Bad(
        "attack: {→phase: {uniform: [0, 1], normal: [0, 1]}}",
        "attack.phase",
        "{normal: [mean, sd]}",
    ),
    Bad("attack: {→phase: {gaussian: [0, 1]}}", "attack.phase", '(got {"gaussian": [0, 1]})'),
    Bad("attack: {→phase: {}}", "attack.phase", "(got {})"),
    Bad("attack: {→phase: [0, 1]}", "attack.phase", "a list has a number for each vehicle"),
    Bad("attack: {phase: {→uniform: [1, 0]}}", "attack.phase.uniform", "lower bound stands first"),
    Bad("attack: {phase: {→uniform: [1]}}", "attack.phase.uniform", "2 entries (got [1])"),
    Bad("attack: {phase: {→uniform: 1}}", "attack.phase.uniform", "must be a list (got 1)"),
    Bad("attack: {phase: {uniform: [0, →.inf]}}", "attack.phase.uniform.1", "must be finite"),
    Bad("attack: {phase: {uniform: [0, →true]}}", "attack.phase.uniform.1", "a number (got true)"),
    Bad("attack: {phase: {→normal: [0, -1]}}", "attack.phase.normal", "not negative (got [0, -1])"),
    Bad("attack: {phase: {→choice: []}}", "attack.phase.choice", "(got [])"),
    Bad(
        "attack: {→magnitude: {uniform: [-1, 1]}}",
        "attack.magnitude",
        "at least 0, whatever is drawn (got {",
    ),
    Bad(
        "attack: {→magnitude: {normal: [5, 1]}}",
        "attack.magnitude",
        "at least 0, whatever is drawn (got {",
    ),
    Bad("initial: {→speed: 0}", "initial.speed", "must be greater than 0 (got 0)"),
    Bad(
        "initial: {→speed: {uniform: [0, 1]}}",
        "initial.speed",
        "must be greater than 0, whatever is drawn",
    ),
    Bad(
        "initial: {→speed: {normal: [1, 0.1]}}",
        "initial.speed",
        "must be greater than 0, whatever is drawn",
    ),
    Bad(
        "initial: {→speed: {choice: [1, -1]}}",
        "initial.speed",
        "must be greater than 0, whatever is drawn",
    ),
    Bad(
        "gain: [1, {→uniform: [4, 3]}, 3]",
        "gain.1.uniform",
        "lower bound stands first (got [4, 3])",
    ),
    Bad(
        "gain: [1, 3, →{gaussian: [3, 1]}]",
        "gain.2",
        "{normal: [mean, sd]} or {choice: [...]} (got {",
    ),
    Bad(
        "topology: {→navigator_weight: {uniform: [0, 0.5]}}",
        "topology.navigator_weight",
        "than 0, whatever",
    ),
    Bad(
        "topology: {→navigator_weight: {choice: [0.1, 2]}}",
        "topology.navigator_weight",
        "most 1, whatever",
    ),
    Bad(
        "topology: {→navigator_weight: {choice: [0.1, 1]}}",
        "topology.navigator_weight",
        "less than 1 where",
    ),
    Bad(
        "topology: {kind: edges, edges: [[1, 0, →{uniform: [0, 1]}]]}",
        "topology.edges.0.2",
        "must be greater than 0, whatever is drawn (got {",
    ),
    Bad(
        "topology: {kind: edges, edges: [[1, 0, →{uniform: [1, 1e10]}]]}",
        "topology.edges.0.2",
        "must be at most 1e+09, whatever is drawn (got {",
    ),
    Bad(
        "defence: {→tolerance: {normal: [1, 0.1]}}",
        "defence.tolerance",
        "at least 0, whatever is drawn",
    ),
    Bad("engine: {→rtol: {uniform: [1e-7, 1]}}", "engine.rtol", "less than 1, whatever is drawn"),
    Bad("engine: {→atol: {choice: [1e-9, 0]}}", "engine.atol", "greater than 0, whatever is drawn"),
]

UNKNOWN = [
    Bad("→vehicels: 3", "vehicels", "unknown key (did you mean 'vehicles'?"),
    Bad("→frobnicate: 3", "frobnicate", "unknown key (known here: "),
    Bad("→12: 3", "12", "unknown key"),
    Bad("→1.5: 3", "1.5", "unknown key"),
    Bad("→<<: {seed: 3}", "<<", "unknown key"),
    Bad("initial: {→sped: 1}", "initial.sped", "did you mean 'speed'?"),
    Bad("save: {→trajectory: all}", "save.trajectory", "did you mean 'trajectories'?"),
]

SAVE = [
    Bad("→save: all", "save", 'must be a mapping (got "all")'),
    Bad("save: {→errors: yes}", "save.errors", 'must be true or false (got "yes")'),
    Bad("save: {→errors: on}", "save.errors", 'must be true or false (got "on")'),
    Bad("save: {→errors: 1}", "save.errors", "must be true or false (got 1)"),
    Bad("save: {→trajectories: some}", "save.trajectories", "worst"),
    Bad("save: {→trajectories: {best: 3}}", "save.trajectories", '{worst: K} (got {"best": 3})'),
    Bad("save: {trajectories: {→worst: 0}}", "save.trajectories.worst", "at least 1 (got 0)"),
    Bad(
        "save: {trajectories: {→samples: 3}}",
        "save.trajectories.samples",
        "must be a list (got 3)",
    ),
    Bad(
        "save: {trajectories: {samples: [0, →-1]}}",
        "save.trajectories.samples.1",
        "must be at least 0 (got -1)",
    ),
    Bad(
        "samples: 3\nsave: {trajectories: {→samples: [0, 3]}}",
        "save.trajectories.samples",
        "samples are 0 to 2 (got 3)",
    ),
    Bad(
        "save: {trajectories: {samples: [0], →worst: 3}}",
        "save.trajectories.worst",
        "unknown key",
    ),
]

# --- several keys together ------------------------------------------------------------------------

TIMES = [
    Bad(
        "→horizon: 20\noutput_step: 1e-7\ntick: 1e-7",
        "horizon",
        "must be at most 100,000,000 times output_step",
    ),
    Bad("→tick: 0.03", "output_step", "must be a multiple of tick = 0.03 (got 0.1)"),
    Bad("tick: 0.03\n→output_step: 0.1", "output_step", "must be a multiple of tick = 0.03"),
    Bad("tail: 0\n→horizon: 0.25", "horizon", "must be a multiple of output_step = 0.1 (got 0.25)"),
    Bad("→horizon: 30.0000001", "horizon", "(got 30.0000001)"),
    Bad("→tail: 0.25", "tail", "must be a multiple of output_step = 0.1 (got 0.25)"),
    Bad("→horizon: 3", "tail", "must fit into horizon = 3 (got 5)"),
    Bad("horizon: 3\n→tail: 4", "tail", "must fit into horizon = 3 (got 4)"),
]

GRAPHS = [
    Bad(
        """
        vehicles: 4
        attack: none
        topology:
          kind: edges
          →edges:
            - [1, 0, 1]
            - [2, 3, 1]
            - [3, 2, 1]
            - [4, 1, 1]
        """,
        "topology.edges",
        "the navigator does not reach 2, 3",
    ),
    Bad(
        "topology: {kind: edges, edges: [[1, 0, 1], [2, 1, →-0.5]]}",
        "topology.edges.1.2",
        "must be greater than 0 (got -0.5)",
    ),
    Bad(
        "topology: {kind: edges, edges: [[1, 0, →0]]}",
        "topology.edges.0.2",
        "must be greater than 0 (got 0)",
    ),
    Bad("topology: {kind: edges, edges: [[1, 0, →.nan]]}", "topology.edges.0.2", "must be finite"),
    Bad(
        "topology: {kind: edges, edges: [[1, 0, →true]]}", "topology.edges.0.2", "must be a number"
    ),
    Bad("topology: {kind: edges, edges: [[→1.0, 0, 1]]}", "topology.edges.0.0", "must be a whole"),
    Bad("topology: {kind: edges, edges: [→[2, 1]]}", "topology.edges.0", "an entry is missing"),
    Bad("topology: {kind: edges, edges: [→[2, 1, 1, 1]]}", "topology.edges.0", "3 entries"),
    Bad("topology: {kind: edges, edges: [→2]}", "topology.edges.0", "must be a list (got 2)"),
    Bad(
        """
        vehicles: 2
        attack: none
        topology:
          kind: edges
          edges:
            - [1, 0, 1]
            - →[2, 2, 1]
        """,
        "topology.edges.1",
        "2 hears itself, which law: local alone allows",
    ),
    Bad(
        """
        vehicles: 2
        attack: none
        topology:
          kind: edges
          edges:
            - [1, 0, 1]
            - [2, 1, 1]
            - →[1, 0, 0.5]
        """,
        "topology.edges.2",
        "[1, 0] is given twice",
    ),
    Bad(
        """
        vehicles: 2
        attack: none
        topology: {kind: edges, edges: [[1, 0, 1], [2, 1, 1], →[2, 3, 1]]}
        """,
        "topology.edges.2",
        "(got [2, 3])",
    ),
    Bad(
        """
        vehicles: 2
        attack: none
        topology: {kind: edges, edges: [[1, 0, 1], →[0, 1, 1], [2, 1, 1]]}
        """,
        "topology.edges.1",
        "(got [0, 1])",
    ),
    Bad(
        "attack: none\n→vehicles: 9\ntopology: {kind: edges, edges: [[1, 0, 1], [2, 1, 1]]}",
        "vehicles",
        "the graph has 2 vehicles (got 9)",
    ),
    Bad(
        "topology: {kind: file, path: a, content: {→a: b}}",
        "topology.content.a",
        "must be edges i,j,w",
    ),
    Bad("attack: {→vehicles: [2, 8]}\ntopology: figure1", "attack.vehicles", "are 1 to 5 (got 8)"),
    Bad("→vehicles: 12\ntopology: figure1", "vehicles", "figure1 has 5 vehicles (got 12)"),
    Bad("attack: none\n→vehicles: 2", "vehicles", "at least 3 vehicles (got 2)"),
]

SCENARIOS = [
    Bad("→gain: [1, 0.1, 0.1]", "gain", "unstable: eigenvalues -1"),  # (s + 1)(s² - 0.9 s + 1)
    Bad("→gain: [1, 0.1, 0.1]", "gain", "0.45+0.893j"),
    Bad("→gain: [0, 3, 3]", "gain", "unstable"),
    Bad(
        "→gain: [{uniform: [0.5, 1]}, {choice: [3, 0.1]}, {uniform: [0.1, 3]}]",
        "gain",
        "0.45+0.893j where [1.0, 0.1, 0.1] is drawn (got [{",
    ),
    Bad("→gain: [{uniform: [-1, 1]}, 3, 3]", "gain", "where [-1.0, 3.0, 3.0] is drawn"),
    Bad("→gain: [1, 3, {normal: [3, 0.1]}]", "gain", "where [1.0, 3.0, 0.0] is drawn"),
    Bad("→gain: [{normal: [1, 0.1]}, 3, 3]", "gain", "where [0.0, 3.0, 3.0] is drawn"),
    Bad(
        """
        →navigator:
          amplitude: [100, 60]
          frequency: [0.2, 0.3]
          phase: [1.5707963267948966, 0]  # both velocities vanish at t = 5π
        """,
        "navigator",
        "at t = 15.71 s; at least 0.05 m/s",
    ),
    Bad("→navigator: {amplitude: [0, 0]}", "navigator", "slows to 0 m/s at t = "),
    Bad("attack: {→vehicles: [2, 13]}", "attack.vehicles", "vehicles are 1 to 12 (got 13)"),
    Bad("attack: {→vehicles: [0]}", "attack.vehicles", "vehicles are 1 to 12 (got 0)"),
    Bad("attack: {→vehicles: [2, 5, 2]}", "attack.vehicles", "twice (got [2, 5, 2])"),
    Bad(
        "vehicles: 9\nattack: {→vehicles: [2, 11]}",
        "attack.vehicles",
        "vehicles are 1 to 9 (got 11)",
    ),
    Bad("defence: {→trusted: {13: [1]}}", "defence.trusted", "vehicles are 1 to 12 (got 13)"),
    Bad("defence: {→trusted: {1: [2, 13]}}", "defence.trusted", "sources are 0 to 12 (got 13)"),
    Bad("defence: {→theta: {13: 1}}", "defence.theta", "vehicles are 1 to 12 (got 13)"),
]

SWEEPS = [
    Bad("→sweep: [attack]", "sweep", 'must be a mapping (got ["attack"])'),
    Bad("sweep: {→attack.magnitude: []}", "sweep.attack.magnitude", "(got [])"),
    Bad("sweep: {→attack.magnitude: 5}", "sweep.attack.magnitude", "must be a list, {linspace: "),
    Bad("sweep: {→1: [2]}", "sweep.1", "must be text (got 1)"),
    Bad("sweep: {→atack.magnitude: [1, 2]}", "sweep.atack.magnitude", "did you mean 'attack'?"),
    Bad(
        "sweep: {→attack.magnitud: [1, 2]}",
        "attack.magnitud|sweep.attack.magnitud",
        "did you mean 'magnitude'?",
    ),
    Bad("sweep: {→samples: [1, 2]}", "sweep.samples", "cannot be swept"),
    Bad("sweep: {→name: [a, b]}", "sweep.name", "cannot be swept"),
    Bad("sweep: {→seed: [1, 2]}", "sweep.seed", "cannot be swept"),
    Bad("sweep: {→save.errors: [true]}", "sweep.save.errors", "cannot be swept"),
    Bad(
        "sweep: {tick: {→linspace: [0.01, 0.1]}}",
        "sweep.tick.linspace",
        "an entry is missing",
    ),
    Bad(
        "sweep: {tick: {linspace: [0.01, 0.1, →0]}}", "sweep.tick.linspace.2", "at least 1 (got 0)"
    ),
    Bad("sweep: {tick: {linspace: [0.01, 0.1, →2.5]}}", "sweep.tick.linspace.2", "must be a whole"),
    Bad("sweep: {tick: {linspace: [0, →.inf, 3]}}", "sweep.tick.linspace.1", "must be finite"),
    Bad(
        "sweep: {tick: {geomspace: [→0, 1, 3]}}", "sweep.tick.geomspace.0", "greater than 0 (got 0)"
    ),
    Bad("sweep: {tick: {geomspace: [1, →-1, 3]}}", "sweep.tick.geomspace.1", "(got -1)"),
    Bad("sweep: {→tick: {logspace: [1, 2, 3]}}", "sweep.tick", "{geomspace: [a, b, n]}"),
    Bad(
        "sweep: {tick: {linspace: [0, 1, 3], →step: 2}}",
        "sweep.tick.step",
        "unknown key",
    ),
    Bad(
        "sweep: {attack.magnitude: [1, 2], →attack: [bias, rotating]}",
        "sweep.attack",
        "must stand before the dotted keys",
    ),
    Bad(
        """
        vehicles: 2
        attack: none
        sweep:
          →topology:
            - {kind: edges, edges: [[1, 0, 1], [2, 0, 1]]}
            - {kind: edges, edges: [[1, 0, 1], [2, 1, 1]]}
        """,
        "sweep.topology",
        "label",
    ),
    Bad("sweep: {→topology: [star, star]}", "sweep.topology", "two values are named star"),
    Bad("sweep: {→tick: [0.05, 0.1, 5e-2]}", "sweep.tick", "two values are named 0.05"),
    Bad("sweep: {→attack.magnitude: [1, 1.0]}", "sweep.attack.magnitude", "two values are named 1"),
    Bad(
        "sweep: {attack: [rotating, →none], →attack.magnitude: [→5]}",
        "attack.magnitude",
        "in cell 1 (attack=none, attack.magnitude=5)",
    ),
    Bad("sweep: {attack: [→none], →attack.magnitude: [→5]}", "attack.magnitude", "attack=none"),
    Bad(
        "sweep: {attack.magnitude: [5, →-5]}",
        "attack.magnitude",
        "(got -5), in cell 1 (attack.magnitude=-5)",
    ),
    Bad(
        "sweep: {attack: [bias, rotating], attack.magnitude: [5, →-5]}",
        "attack.magnitude",
        "(got -5), in cell 1 (attack=bias, attack.magnitude=-5)",
    ),
    Bad("sweep: {attack.magnitude: [5, →big]}", "attack.magnitude", 'must be a number (got "big")'),
    Bad("sweep: {→gain.3: [1]}", "sweep.gain.3", "unknown key (known here: 0, 1, 2)"),
    Bad("sweep: {→gain.k0: [1]}", "sweep.gain.k0", "unknown key (known here: 0, 1, 2)"),
    Bad("sweep: {gain.0: [1, →low]}", "gain.0", 'must be a number (got "low"), in cell 1'),
    Bad("sweep: {→vehicles.0: [1]}", "sweep.vehicles.0", "unknown key (known here: vehicles)"),
    Bad("sweep: {→navigator.phase.2: [1]}", "sweep.navigator.phase.2", "has entries 0 to 1"),
    Bad(
        "attack: {kind: envelope, of: bias}\nsweep: {→attack" + ".of" * 40 + ": [1]}",
        "sweep.attack" + ".of" * 40,
        "more than 32 mappings and lists inside each other",
    ),
    Bad(
        "sweep: {→attack.magnitude: [9223372036854775808, 9223372036854775809]}",
        "sweep.attack.magnitude",
        "two values are named 9.22",
    ),
    Bad("sweep: {→topology.kind: [star, path]}", "sweep.topology.kind", "sweep topology instead"),
    Bad(
        "sweep: {→attack.magnitude.uniform: [[0, 1], [0, 2]]}",
        "sweep.attack.magnitude.uniform",
        "attack.magnitude is not a mapping",
    ),
    Bad(
        "sweep: {→defence.theta.3: [0, 1]}",
        "sweep.defence.theta.3",
        "defence.theta is not a mapping",
    ),
    Bad(
        "sweep: {tick: [0.05, →{choice: [0.05, 0.1]}]}",
        "tick",
        'not a distribution (got {"choice": [0.05, 0.1]}), in cell 1',
    ),
    Bad("sweep: {topology: [star, →ring]}", "topology|topology.kind", "in cell 1 (topology=ring)"),
    Bad("sweep: {topology: [star, {→kind: [path]}]}", "topology.kind", '(got ["path"])'),
    Bad("sweep: {topology: [star, →3]}", "topology", "(got 3)"),
    Bad(
        """
        sweep:
          topology:
            - star
            - kind: cyclic
              →navigator_weight: 7
        """,
        "topology.navigator_weight",
        "must be at most 1 (got 7), in cell 1",
    ),
    Bad(
        "attack: {→vehicles: [8]}\nsweep: {topology: [star, figure1]}",
        "attack.vehicles",
        "in cell 1 (top",
    ),
    Bad("sweep: {gain: [[1, 3, 3], →[1, 0.1, 0.1]]}", "gain", "0.45+0.893j"),
    Bad(
        """
        vehicle: double_integrator
        →gain: [[1, 2], [2, 3]]
        topology: {kind: switching, every: 0.5, networks: [path, star]}
        engine: exact
        """,
        "gain|engine",
        "takes gains by axis only in one network",
    ),
    Bad("sweep: {attack.vehicles: [[2], →[13]]}", "attack.vehicles", "(got 13), in cell 1"),
    Bad("sweep: {→tail: {linspace: [5, 35, 2]}}", "tail", "must fit into horizon = 30 (got 35)"),
    Bad("sweep: {→vehicles: [11, 12]}\nsave: {errors: true}", "sweep.vehicles", "save"),
    Bad("sweep: {→horizon: [30, 40]}\nsave: {trajectories: all}", "sweep.horizon", "save"),
    Bad(
        "sweep: {→output_step: [0.1, 0.2]}\nsave: {trajectories: {worst: 1}}",
        "sweep.output_step",
        "save",
    ),
]

OVERRIDES = [
    Bad("", "", "KEY=VALUE", ("→seed",)),
    Bad("", "", "KEY=VALUE", ("→=3",)),
    Bad("", "foo", "unknown key", ("→foo=3",)),
    Bad("", "attack.magnitud", "did you mean 'magnitude'?", ("→attack.magnitud=3",)),
    Bad("attack: bias", "attack.frequency", "unknown key", ("→attack.frequency=3",)),
    Bad("", "gain|", "not YAML", ("→gain=[1, 3",)),
    Bad("", "gain", "must be 3, one for each order of two_wheeled (got 2)", ("→gain=[1, 3]",)),
    Bad("", "gain.1", 'must be a number (got "x")', ("→gain=[1, x, 3]",)),
    Bad("", "attack.kind", "given twice", ("→attack={kind: bias, kind: none}",)),
    Bad("", "seed", "python/object", ("→seed=!!python/object:x 3",)),
    Bad("", "name", "plain file name", ("→name=../x",)),
    Bad("", "name", "must be text (got null)", ("→name=",)),
    Bad("", "attack|attack.kind", "did you mean 'rotating'?", ("→attack=rotatin",)),
    Bad("", "attack|attack.kind", "did you mean 'rotating'?", ("→attack.kind=rotatin",)),
    Bad("", "initial.speed", "must be greater than 0", ("→initial={speed: 0}",)),
    Bad(
        "",
        "initial.speed",
        "must be greater than 0, whatever is drawn",
        ("→initial.speed={uniform: [0, 1]}",),
    ),
    Bad("", "tail", "must fit into horizon = 3", ("→horizon=3",)),
    Bad("", "attack.vehicles", "(got 13)", ("→attack.vehicles=[13]",)),
    Bad("", "attack.vehicles", "must be a list", ("→attack.vehicles.0=3",)),
    Bad(
        "attack: {vehicles: [2]}", "attack.vehicles.1", "entries 0 to 0", ("→attack.vehicles.1=3",)
    ),
    Bad("", "attack..magnitude", "KEY a dotted name", ("→attack..magnitude=3",)),
    Bad("", "attack.magnitude", "(got -2), in cell 1", ("→sweep.attack.magnitude=[1, -2]",)),
    Bad("", "sweep.attack.magnitude", "must be a list", ("→sweep.attack.magnitude=5",)),
    Bad("", "sweep.foo", "unknown key", ("→sweep.foo=[5]",)),
    Bad("", "seed", "(got -2)", ("seed=-1", "→seed=-2")),
    Bad("→tick: -1", "tick", "(got -1)", ("seed=3",)),
    Bad("horizon: 30", "horizon.long", "horizon is not a mapping", ("→horizon.long=1",)),
]

# --- the text itself ------------------------------------------------------------------------------

FILES = [
    Bad("→", "name", "required"),
    Bad("→# a comment is all", "name", "required"),
    Bad("# jaxnet run bad.yaml\n→samples: 3", "name", "required"),
    Bad("→name: ../x", "name", '(got "../x")'),
    Bad("→name: .x", "name", '(got ".x")'),
    Bad("→name: a/b", "name", '(got "a/b")'),
    Bad("→name: ''", "name", '(got "")'),
    Bad('→name: "x\\n"', "name", '(got "x\\n")'),
    Bad("→name: x.", "name", '(got "x.")'),
    Bad(f"→name: {'x' * 101}", "name", "100"),
    Bad("→name: 3", "name", "must be text (got 3)"),
    Bad("→name: 1e-3", "name", "must be text (got 0.001)"),
    Bad("→name: true", "name", "must be text (got true)"),
    Bad("→name:", "name", "must be text (got null)"),
    Bad("name: x\n→name: y", "name", "given twice"),
    Bad("name: x\n'seed': 3\n→seed: 3", "seed", "given twice"),
    Bad("name: x\nattack:\n  kind: bias\n  →kind: none", "attack.kind", "given twice"),
    Bad("name: x\ndefence: {theta: {1: 1, →0o1: 2}}", "defence.theta.1", "given twice"),
    Bad("name: x\n? →[a]\n: 3", "", "a key must be"),
    *(
        Bad(text, "", "not YAML: a tab here; blanks indent and separate")
        for text in (
            "name: x\nattack:\n→\tkind: bias",
            "name: x\nattack:\n  - 1\n→\t- 2",
            "name: x\ngain:\n  -→\t- 1",
        )
    ),
    Bad("name: x\ngain: [1, 3, 3\nseed→: 3", "", "expected ',' or ']'"),
    Bad("name: 'x→", "", "not YAML"),
    Bad("name: x→: y", "", "not YAML: mapping values are not allowed in this context (got :)"),
    Bad("name: →@x", "", "not YAML: found character that cannot start any token (got @x)"),
    Bad("name: x\nseed: 3 →\x07", "", "not YAML"),
    Bad("name: x\n→---\nname: y", "", "another document"),
    Bad("→%YAML 2.0\n---\nname: x", "", "not YAML"),
    Bad("# jaxnet run bad.yaml\n→- name: x", "", "a config is a mapping of keys to values"),
    Bad("# jaxnet run bad.yaml\n→hello", "", "a config is a mapping of keys to values"),
    Bad("name: x\ngain: →*g", "", "undefined alias (got *g)"),
    Bad(
        "name: x\ntopology: →&a {kind: edges, edges: [→*a]}",
        "topology.edges.0",
        "an alias inside its own anchor",
    ),
    Bad("name: x\nseed: →!!python/object:os.system 3", "seed", "python/object:os.system"),
    Bad("name: x\ngain: →!!python/tuple [1, 3, 3]", "gain", "python/tuple"),
    Bad("name: x\nattack: →!!python/object:os.system {kind: none}", "attack", "python/object"),
    Bad("name: x\nattack: →!mine {kind: none}", "attack", "!mine"),
    Bad("name: x\nsave: {errors: →!!bool yes}", "save.errors", "bool"),
    Bad(
        "name: x\ngain: " + "[" * 31 + "→[" + "]" * 32, "", "more than 32 mappings and lists inside"
    ),
    Bad(
        "name: x\ngain: " + "[" * 31 + "→[" + "[" * 99_000,
        "",
        "more than 32 mappings and lists inside",
    ),
    Bad("name: x\n" + "→" + "- " * 99_000, "", "not YAML"),
    Bad(
        'name: x\nattack: {label: →"a\\0b"}', "attack.label", "the character '\\x00' is not allowed"
    ),
    Bad('name: x\nattack: {label: "\\u→d800"}', "", "not YAML: found invalid Unicode character"),
    Bad('name: x\n→"a\\nb": 1', "a\\nb", "unknown key"),
    Bad(f"name: x\n→seed: {'9' * 400}", "seed", "must be a whole number (got Infinity)"),
    Bad(f"name: x\n→seed: 0x{'f' * 400}", "seed", "must be a whole number (got Infinity)"),
]

CORPUS = [
    *map(
        named,
        NUMBERS
        + KINDS
        + DISTRIBUTIONS
        + UNKNOWN
        + SAVE
        + TIMES
        + GRAPHS
        + SCENARIOS
        + SWEEPS
        + OVERRIDES,
    ),
    *FILES,
]


def title(bad: Bad) -> str:
    """What pytest calls the test of a config: its text but for the name, in a line."""
    words = " ".join((bad.text.removeprefix("name: bad\n"), *bad.overrides)).split()
    return " ".join(words).replace(ARROW, "")[:70] or "empty"


def arrows(path: Path, bad: Bad) -> list[str]:
    """Places before which the arrows of a config stand, as messages give them."""
    in_text = [
        f"{path}:{number}:{column + 1}"
        for number, line in enumerate(bad.text.split("\n"), start=1)
        for column in accumulate(map(len, line.split(ARROW)[:-1]))
    ]
    marked = [word for word in bad.overrides if ARROW in word]
    return in_text + [f"command line '{word.replace(ARROW, '')}'" for word in marked]


def head(place: str, key: str) -> str:
    """How a message begins; a fault of the text itself has no key."""
    return f"{place}: {key}: " if key else f"{place}: "


def check(path: Path, text: str, overrides: tuple[str, ...] = ()) -> click.testing.Result:
    """What `jaxnet check` does with a text, its arrows taken out, and overrides likewise."""
    path.write_bytes(text.replace(ARROW, "").encode())
    words = [word.replace(ARROW, "") for word in overrides]
    return click.testing.CliRunner().invoke(main, ["check", str(path), *words])


def refusal(result: click.testing.Result) -> list[str]:
    """Lines on stderr of a config that was refused as the contract says."""
    assert result.exception is None or isinstance(result.exception, SystemExit), result.exception
    assert result.exit_code == 2, result.output
    assert result.stdout == ""
    return result.stderr.splitlines()


@pytest.mark.parametrize("bad", CORPUS, ids=title)
def test_bad_config_is_refused_at_its_place(bad: Bad, tmp_path: Path):
    path = tmp_path / "bad.yaml"
    lines = refusal(check(path, bad.text, bad.overrides))
    heads = [head(place, key) for key in bad.key.split("|") for place in arrows(path, bad)]
    assert len(lines) == 1, "\n".join(lines)
    found = next((each for each in heads if lines[0].startswith(each)), None)
    assert found is not None, f"{lines[0]}\nshould start with {' or '.join(heads)}"
    assert bad.says in lines[0].removeprefix(found)


def absent(path: Path) -> None:
    """Leave no file there."""


def not_utf8(path: Path) -> None:
    """Write a name in Latin 1."""
    path.write_bytes("name: früh\n".encode("latin-1"))


@pytest.mark.parametrize(
    ("make", "reason"),
    [
        (absent, "No such file or directory"),
        (Path.mkdir, "Is a directory"),
        (not_utf8, "not UTF-8 text"),
    ],
)
def test_what_cannot_be_read_is_named(make, reason: str, tmp_path: Path):
    path = tmp_path / "bad.yaml"
    make(path)
    lines = refusal(click.testing.CliRunner().invoke(main, ["check", str(path)]))
    assert lines == [f"{path}: cannot be read: {reason}"]


@pytest.mark.parametrize(
    "text",
    [
        "horizon: 1e300\noutput_step: 1e-300",
        "tick: 1e-320",
        "horizon: " + "9" * 400,
        "horizon: " + "9" * 5000,
        "gain: " + "[" * 3000 + "]" * 3000,
        "vehicles: 99999999999999999999\nattack: none",
        "defence: {theta: 99999999999999999999}",
        "save: {trajectories: {samples: [99999999999999999999]}}",
        "sweep: {attack.magnitude: {linspace: [-1e308, 1e308, 3]}}",
        "navigator: {amplitude: [1e200, 1e200], frequency: [1e100, 1e100]}",
        "topology: {kind: edges, edges: [[1, 0, 1e308], [1, 2, 1e308]]}",
    ],
    ids=lambda text: text[:40],
)
def test_extremes_end_without_a_traceback(text: str, tmp_path: Path):
    result = check(tmp_path / "bad.yaml", f"name: bad\n{text}\n")
    assert result.exception is None or isinstance(result.exception, SystemExit), result.exception
    assert result.exit_code in (0, 2)


class Faults(NamedTuple):
    """A config with several faults, and their keys in the order of its arrows."""

    text: str
    keys: list[str]
    overrides: tuple[str, ...] = ()


ALL_AT_ONCE = [
    Faults(
        """
        name: bad
        →horizon: soon
        →gain: [1, 3]
        attack: {→magnitude: -1}
        →colour: red
        """,
        ["horizon", "gain", "attack.magnitude", "colour"],
    ),
    Faults(
        """
        →name: ../x
        engine: {→rtol: 0}
        save: {→errors: yes}
        sweep: {→attack.magnitude: 5}
        """,
        ["name", "engine.rtol", "save.errors", "sweep.attack.magnitude"],
    ),
    Faults(
        """
        name: bad
        →tail: 0.25
        →gain: [1, 0.1, 0.1]
        →navigator: {amplitude: [0, 0]}
        attack: {→vehicles: [13]}
        """,
        ["tail", "gain", "navigator", "attack.vehicles"],
    ),
    Faults(  # what one key shows, and what several together show
        """
        name: bad
        →seed: -1
        →gain: [1, 0.1, 0.1]
        →navigator: {amplitude: [0, 0]}
        engine: {→rtol: 0}
        """,
        ["seed", "gain", "navigator", "engine.rtol"],
    ),
    Faults(
        """
        name: bad
        vehicles: 3
        topology: {kind: edges, →edges: [[1, 0, 1], [2, 3, 1], [3, 2, 1]]}
        attack: {→vehicles: [4]}
        """,
        ["topology.edges", "attack.vehicles"],
    ),
    Faults(
        """
        name: bad
        →gain: [1, 0.1, 0.1]
        sweep:
          →seed: [1, 2]
          attack.magnitude: [1, 2]
          →attack: [bias, rotating]
        """,
        ["gain", "sweep.seed", "sweep.attack"],
    ),
    Faults(
        """
        name: bad
        seed: 3
        →seed: 4
        attack:
          kind: bias
          →kind: bias
        →tick: -1
        """,
        ["seed", "attack.kind", "tick"],
    ),
    Faults("name: bad\n→seed: -1", ["seed", "tick", "foo"], ("→tick=-1", "→foo=3")),
    Faults("name: bad\n→seed: -1", ["seed", "", ""], ("→tick", "→=3")),
]


@pytest.mark.parametrize("faults", ALL_AT_ONCE, ids=lambda faults: " and ".join(faults.keys))
def test_all_faults_are_told_at_once(faults: Faults, tmp_path: Path):
    path = tmp_path / "bad.yaml"
    bad = Bad(dedent(faults.text), "", "", faults.overrides)
    lines = refusal(check(path, bad.text, bad.overrides))
    told = [line for line in lines if line.startswith((str(path), "command line"))]
    heads = [head(*each) for each in zip(arrows(path, bad), faults.keys, strict=True)]
    missing = [each for each in heads if not any(line.startswith(each) for line in told)]
    assert not missing, "\n".join([*lines, "lacks", *missing])
    assert len(told) == len(heads), "\n".join(lines)


BOMB = "\n".join(["a0: &a0 [x, x]", *(f"a{n + 1}: &a{n + 1} [*a{n}, *a{n}]" for n in range(25))])
CHAIN = "\n".join(["a0: &a0 [x]", *(f"a{n + 1}: &a{n + 1} [*a{n}]" for n in range(100))])


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (BOMB, "aliases repeat more than 100,000 values"),
        (BOMB.replace("&a24 [", "&a24 !mine ["), "aliases repeat more than 100,000 values"),
        (CHAIN, "more than 32 mappings and lists inside each other"),
        ("attack: " + "{kind: envelope, of: " * 90 + "bias" + "}" * 90, "more than 32 mappings"),
        ("a: &a !mine [*a]", "the tag !mine has no meaning here"),
        ("attack: {label: " + "x" * 10**6 + ", lable: 1}", "unknown key"),
        ("x" * 10**6, "a config is a mapping"),
        ("? " + "x" * 10**6 + "\n: 1", "unknown key"),
    ],
    ids=lambda text: text[:30],
)
def test_what_is_nested_or_repeated_is_refused_in_a_second(text: str, says: str, tmp_path: Path):
    """Processor time, of one line that is not long."""
    (tmp_path / "bad.yaml").write_text(text)
    began = time.process_time()
    with pytest.raises(jaxnet.ConfigError, match=says) as raised:
        jaxnet.load(tmp_path / "bad.yaml", ["name=bad"])
    assert time.process_time() - began < 2  # a second on a machine that has nothing else to do
    assert "\n" not in str(raised.value.problems[0])
    assert len(str(raised.value.problems[0])) < 5000


def nested(depth: int) -> list[Any]:
    """A list of one list of one list …"""
    return [nested(depth - 1)] if depth else []


CYCLE: list[Any] = []
CYCLE.append(CYCLE)


@pytest.mark.parametrize(
    ("given", "says"),
    [
        ({"gain": nested(40)}, "more than 32 mappings and lists"),
        ({"gain": CYCLE}, "more than 32 mappings and lists"),
        ({"seed": 10**5000}, "at most 300 digits"),
        ({"seed": -(10**5000)}, "at most 300 digits"),
        ({"seed": 2**63}, "less than"),
        ({"defence": {"theta": {("a", 1): 2}}}, "must be a number, text"),
        ({"gain": {1, 2, 3}}, "must be a number, text"),
        ({"name": "a\0b"}, "not allowed"),
        ("a\0b", "cannot be read: embedded null byte"),
        ("nothing://there/study.yaml", "cannot be read"),
    ],
)
def test_what_a_script_gives_is_refused_as_a_config_error(given: Any, says: str):
    with pytest.raises(jaxnet.ConfigError, match=says):
        jaxnet.load(given)


def test_a_script_gives_so_many_values(monkeypatch):
    """Counted before any text is made of them."""
    monkeypatch.setattr(study, "MOST_VALUES", 1000)
    with pytest.raises(jaxnet.ConfigError, match=r"gain.0.9.*more than 1,000 values"):
        jaxnet.load({"gain": [[[0] * 100] * 100] * 100})


WORDS = [
    *(
        "0",
        "-0.0",
        "-1",
        "1e309",
        "-1e308",
        ".inf",
        ".nan",
        "9223372036854775808",
        "9" * 400,
        "1e-320",
    ),
    *(
        "null",
        "true",
        "''",
        "[]",
        "{}",
        "[[[]]]",
        "&a [*a]",
        "{uniform: [0, 1]}",
        "{each: 1}",
        "٣",
        '"\\0"',
    ),
    *(
        "{<<: {a: 1}}",
        "{linspace: [0, 1, 3]}",
        "0x" + "f" * 99,
        "!!str 1",
        "{share: 0.5}",
        "{1: 2}",
        "none",
    ),
    *(
        "[1, 0, 1]",
        "{random: 3}",
        "'\\ud800'",
        "\t",
        "star",
        "rotating",
        "{kind: file, path: /dev/null}",
    ),
]
SEEDS = [
    path.read_text() for path in sorted((Path(__file__).parents[1] / "configs").glob("*.yaml"))
]


def mutated(random: Random) -> str:
    """A config that ships, with one to three words, lines or characters replaced."""
    text = random.choice(SEEDS)
    for _ in range(random.randint(1, 3)):
        words = list(re.finditer(r"(?<=: )[^\n#]+|[\w.]+", text))
        found = random.choice(words)
        new = random.choice([*WORDS, random.choice(words)[0], ""])
        text = text[: found.start()] + new + text[found.end() :]
    return text


def test_whatever_is_in_a_config_it_loads_or_is_a_config_error(tmp_path: Path):
    """Of configs that ship, with a few words replaced at random."""
    random, outcomes = Random(38), {True: 0, False: 0}
    for _ in range(150):
        text = mutated(random)
        (tmp_path / "bad.yaml").write_text(text)
        try:
            jaxnet.load(tmp_path / "bad.yaml")
        except jaxnet.ConfigError as error:
            outcomes[False] += len(str(error).splitlines()) == len(error.problems)
        else:
            outcomes[True] += 1
    assert sum(outcomes.values()) == 150
    assert min(outcomes.values()) > 10


# --- good ones ------------------------------------------------------------------------------------


def load(tmp_path: Path, text: str, *overrides: str):
    """The study of a text; `jaxnet check` must be content with it too."""
    path = tmp_path / "good.yaml"
    result = check(path, text, overrides)
    assert result.exception is None, result.stderr or repr(result.exception)
    assert (result.exit_code, result.stderr) == (0, "")
    return jaxnet.load(path, overrides)


def value_at(study: Any, key: str) -> Any:
    """A study's value by its dotted key."""
    value = study.config
    for part in key.split("."):
        value = getattr(value, part)
    return value


@pytest.mark.parametrize(
    ("text", "key", "value"),
    [
        ("name: on", "name", "on"),
        ("name: yes", "name", "yes"),
        ("name: No", "name", "No"),
        ("name: 2026-01-31", "name", "2026-01-31"),
        ("name: 1_000", "name", "1_000"),
        ("name: 0b11", "name", "0b11"),
        ("name: '3'", "name", "3"),
        ("name: x\nseed: 0o17", "seed", 15),
        ("name: x\nseed: 017", "seed", 17),
        ("name: x\nseed: 0x1F", "seed", 31),
        ("name: x\nseed: +5", "seed", 5),
        ("name: x\nhorizon: 3e1", "horizon", 30.0),
        ("name: x\ntail: 5.", "tail", 5.0),
        ("name: x\nengine: {rtol: 1e-3}", "engine.rtol", 1e-3),
        ("name: x\nengine: {rtol: 1E-3}", "engine.rtol", 1e-3),
        ("name: x\nengine: {rtol: .001}", "engine.rtol", 1e-3),
        ("name: x\nsave: {errors: True}", "save.errors", True),
        ("name: x\nattack: {label: on}", "attack.label", "on"),
        ("name: x\nattack: {label: ~}", "attack.label", None),
        ("name: x\nattack: {label: null}", "attack.label", None),
        ("name: x\nattack: {label: }", "attack.label", None),
        ("name: x\ndefence: {theta: {0x2: 1}}", "defence.theta", {2: 1}),
        ("%YAML 1.2\n---\nname: x\n...\n", "name", "x"),
        ("\ufeffname: x\r\nseed: 3\r\n", "seed", 3),
        ('{"name": "x", "gain": [1, 2, 3]}', "gain", [1.0, 2.0, 3.0]),
        ("name:\tx\t# text", "name", "x"),
        ("name: x\ngain: [1,\n\t3, 3]", "gain", [1.0, 3.0, 3.0]),
        ("name: x\nattack: {label: 'a\tb'}", "attack.label", "a\tb"),
        ('name: x\nattack: {label: "a\tb"}', "attack.label", "a\tb"),
        ("name: x\nattack:\n  label: |\n    a\tb\n    \tc\n", "attack.label", "a\tb\n\tc\n"),
        ("name: x\ngain: &g [1, 2, 3]\nsweep: {gain: [*g]}", "gain", [1.0, 2.0, 3.0]),
    ],
)
def test_yaml_is_read_as_version_1_2(text: str, key: str, value: Any, tmp_path: Path):
    read = value_at(load(tmp_path, text), key)
    assert read == value
    assert type(read) is type(value)


@pytest.mark.parametrize(
    "text",
    [
        "horizon: 15\nnavigator:\n"  # it stands still at t = 5π
        "  {amplitude: [100, 60], frequency: [0.2, 0.3], phase: [1.5707963267948966, 0]}",
        "horizon: 30.00000001",  # 1e-9 relative is let pass
        "horizon: 5\ntail: 5",
        "tail: 0",
        "tick: 0",
        "gain: [8.9, 3, 3]",
        "gain: [{uniform: [0.1, 8.9]}, {choice: [3, 4]}, {normal: [3, 0]}]",
        "topology: {navigator_weight: {uniform: [1e-9, 0.999]}}",
        "vehicles: 1\nattack: none\ntopology: {kind: edges, edges: [[1, 0, {uniform: [1e-9, 1e9]}]]}",
        "engine: {rtol: {uniform: [1e-9, 0.999]}, atol: {normal: [1e-9, 0]}}",
        "defence: {tolerance: {uniform: [0, 1]}}",
        "seed: 9223372036854775807",
        "attack: {magnitude: 0}",
        "attack: {magnitude: {uniform: [0, 0]}}",
        "initial: {speed: {normal: [1, 0]}}",
        "initial: {speed: {choice: [1]}}",
        "defence: {trusted: {1: [0, 12]}, theta: {12: 0}}",
        "samples: 4\nsave: {trajectories: {samples: [0, 3]}}",
        "vehicles: 5\nattack: none\ntopology: figure1",
        "vehicles: 3\nattack: none",
        "vehicles: 1\nattack: none\ntopology: star",
        "sweep: {}",
        "sweep: {topology: [star, path]}\nsave: {errors: true, trajectories: {worst: 1}}",
    ],
)
def test_what_only_just_holds_is_accepted(text: str, tmp_path: Path):
    load(tmp_path, f"name: good.one-2_3\n{text}\n")


@pytest.mark.parametrize(
    ("text", "overrides", "key", "value"),
    [
        ("", [], "topology.kind", "cyclic"),
        ("topology: star", [], "topology.kind", "star"),
        ("attack: bias", ["attack.magnitude=7"], "attack.magnitude", 7.0),
        ("attack: bias", ["attack.magnitude=7"], "attack.kind", "bias"),
        ("attack: {kind: bias, magnitude: 7}", ["attack=rotating"], "attack.magnitude", 5.0),
        ("", ["attack=sinusoid", "attack.direction=1"], "attack.direction", 1.0),
        ("", ["initial.speed=1"], "initial.speed", 1.0),
        ("", ["defence.trusted={1: [2]}"], "defence.trusted", {1: [2]}),
        ("", ["save.trajectories={worst: 2}"], "save.trajectories.worst", 2),
        ("seed: -1", ["seed=3"], "seed", 3),
        ("", ["name=other"], "name", "other"),
    ],
)
def test_overrides_reach_into_kinds(
    text: str, overrides: list[str], key: str, value: Any, tmp_path: Path
):
    assert value_at(load(tmp_path, f"name: good\n{text}\n", *overrides), key) == value


def test_overrides_of_a_script_are_a_mapping_of_plain_values(tmp_path: Path):
    path = tmp_path / "good.yaml"
    path.write_text("name: good\nattack: bias\n")
    given = {"tick": 1e-2, "attack.magnitude": 7, "attack.label": "1e-3", "save": {"errors": True}}
    study = jaxnet.load(path, given)
    assert [value_at(study, key) for key in list(given)[:3]] == [0.01, 7.0, "1e-3"]
    assert study.config.save.errors is True


@pytest.mark.parametrize(
    ("text", "overrides", "labels"),
    [
        ("", [], [{}]),
        (
            "sweep: {topology: [star, cyclic], attack.magnitude: [0, 5]}",
            [],
            [
                {"topology": "star", "attack.magnitude": 0},
                {"topology": "star", "attack.magnitude": 5},
                {"topology": "cyclic", "attack.magnitude": 0},
                {"topology": "cyclic", "attack.magnitude": 5},
            ],
        ),
        (
            "sweep: {attack: [bias, sinusoid], attack.direction: [1.5]}",
            [],
            [
                {"attack": "bias", "attack.direction": 1.5},
                {"attack": "sinusoid", "attack.direction": 1.5},
            ],
        ),
        (
            "sweep: {defence: [none, trusted_trim, {theta: 2}]}",
            [],
            [
                {"defence": "none"},
                {"defence": "trusted_trim(theta=1)"},
                {"defence": "trusted_trim(theta=2)"},
            ],
        ),
        (
            "sweep: {topology: [{navigator_weight: 0.1}, {navigator_weight: 1}]}",
            [],
            [
                {"topology": "cyclic(navigator_weight=0.1)"},
                {"topology": "cyclic(navigator_weight=1)"},
            ],
        ),
        (
            "sweep: {defence: [{theta: 1, label: weak}, {theta: 2}]}",
            [],
            [{"defence": "weak"}, {"defence": "trusted_trim(theta=2)"}],
        ),
        (
            """
            vehicles: 2
            attack: none
            sweep:
              topology:
                - {kind: edges, edges: [[1, 0, 1], [2, 0, 1]], label: fan}
                - {kind: edges, edges: [[1, 0, 1], [2, 1, 1]], label: line}
                - path
            """,
            [],
            [{"topology": "fan"}, {"topology": "line"}, {"topology": "path"}],
        ),
        (
            """
            vehicles: 1
            attack: none
            sweep: {topology: [star, {kind: edges, edges: [[1, 0, 1]]}]}
            """,
            [],
            [{"topology": "star"}, {"topology": "edges"}],
        ),
        (
            "sweep: {attack.magnitude: {linspace: [0, 1, 3]}}",
            [],
            [{"attack.magnitude": 0.0}, {"attack.magnitude": 0.5}, {"attack.magnitude": 1.0}],
        ),
        (
            "sweep: {attack.magnitude: [0, 5]}",
            ["sweep.attack.magnitude={geomspace: [1, 4, 3]}"],
            [{"attack.magnitude": 1.0}, {"attack.magnitude": 2.0}, {"attack.magnitude": 4.0}],
        ),
        (
            "sweep: {attack.magnitude: [0, 0.5, {uniform: [0, 1]}]}",
            [],
            [
                {"attack.magnitude": "0"},
                {"attack.magnitude": "0.5"},
                {"attack.magnitude": '{"uniform": [0, 1]}'},
            ],
        ),
        (
            "sweep: {topology.navigator_weight: [{uniform: [0.1, 0.2]}], attack.phase.uniform: [[0, 1]]}",
            [],
            [
                {
                    "topology.navigator_weight": '{"uniform": [0.1, 0.2]}',
                    "attack.phase.uniform": "[0, 1]",
                }
            ],
        ),
        (
            "sweep: {attack.vehicles: [[2], [2, 5]]}",
            [],
            [{"attack.vehicles": "[2]"}, {"attack.vehicles": "[2, 5]"}],
        ),
    ],
)
def test_cells_and_their_labels(text: str, overrides: list[str], labels: list, tmp_path: Path):
    study = load(tmp_path, "name: good\n" + dedent(text), *overrides)
    assert [cell.labels for cell in study.cells] == labels
    assert [list(cell.labels) for cell in study.cells] == [list(each) for each in labels]


def test_a_swept_kind_replaces_the_whole_mapping_and_dotted_keys_set_into_it(tmp_path: Path):
    text = """
        name: good
        attack: {kind: sinusoid, magnitude: 9, frequency: 0.1}
        sweep: {attack: [sinusoid, rotating], attack.magnitude: [2]}
    """
    attacks = [cell.scenario.attack for cell in load(tmp_path, dedent(text)).cells]
    assert [attack.kind for attack in attacks] == ["sinusoid", "rotating"]
    assert [attack.magnitude for attack in attacks] == [2.0, 2.0]
    assert [attack.frequency for attack in attacks] == [0.7, 0.7]  # the default, not 0.1
