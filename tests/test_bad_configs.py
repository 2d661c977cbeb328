"""Bad configs: each is refused at its exact place, in words that help; then some tricky good ones.

`bad_configs.txt` has a line for each config with one fault, and says how to read it.
"""

import re
import shlex
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
TABLE = Path(__file__).with_name("bad_configs.txt")
ESCAPED = {"n": "\n", "t": "\t", "\\": "\\"}


class Bad(NamedTuple):
    """A config with one fault: the key to be named, and a part of what is to be said of it."""

    text: str
    key: str
    says: str
    overrides: tuple[str, ...] = ()


def unescaped(text: str) -> str:
    """What a cell of the table means."""
    return re.sub(r"\\(?:x(..)|(.))", lambda m: chr(int(m[1], 16)) if m[1] else ESCAPED[m[2]], text)


def table() -> tuple[list[Bad], list[Bad]]:
    """The rows of one fault, with the first line that gives a config its name, and of several."""
    one: list[Bad] = []
    several: list[Bad] = []
    rows, first = one, "name: bad\n"
    for line in TABLE.read_text(encoding="utf-8").split("\n"):
        if line.startswith("## the text itself"):
            first = ""
        elif line.startswith("## several faults"):
            rows = several
        elif " ¦ " in line and not line.startswith("#"):
            key, says, *cells = line.split(" ¦ ")
            text, *overrides = map(unescaped, cells)
            rows.append(Bad(first + text, key, says, tuple(overrides)))
    return one, several


ONE, SEVERAL = table()
LONG = [
    Bad("name: x\ngain: " + "[" * 31 + "→[" + "[" * n, "", "more than 32 mappings and lists inside")
    for n in (1, 99_000)
] + [
    Bad("name: x\n→" + "- " * 99_000, "", "not YAML"),
    *(
        Bad(f"name: x\n→seed: {digits}", "seed", "must be a whole number (got Infinity)")
        for digits in ("9" * 400, "0x" + "f" * 400)
    ),
]
CORPUS = [*ONE, *LONG]


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


@pytest.mark.parametrize(
    ("make", "reason"),
    [
        (lambda path: None, "No such file or directory"),
        (Path.mkdir, "Is a directory; of results, give {path}/study.yaml"),
        (lambda path: path.write_bytes("name: früh\n".encode("latin-1")), "not UTF-8 text"),
    ],
)
def test_what_cannot_be_read_is_named(make, reason: str, tmp_path: Path):
    path = tmp_path / "bad.yaml"
    make(path)
    lines = refusal(click.testing.CliRunner().invoke(main, ["check", str(path)]))
    assert lines == [f"{path}: cannot be read: {reason.format(path=path)}"]


@pytest.mark.parametrize("bad", SEVERAL, ids=lambda bad: bad.key)
def test_all_faults_are_told_at_once(bad: Bad, tmp_path: Path):
    path = tmp_path / "bad.yaml"
    lines = refusal(check(path, bad.text, bad.overrides))
    told = [line for line in lines if line.startswith((str(path), "command line"))]
    keys = bad.key.split(", ")
    heads = [head(*each) for each in zip(arrows(path, bad), keys, strict=True)]
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


WORDS = """0 ¦ -0.0 ¦ -1 ¦ 1e309 ¦ -1e308 ¦ .inf ¦ .nan ¦ 9223372036854775808 ¦ 1e-320 ¦ null ¦ true
 ¦ '' ¦ [] ¦ {} ¦ [[[]]] ¦ &a [*a] ¦ {uniform: [0, 1]} ¦ {each: 1} ¦ ٣ ¦ "\\0" ¦ {<<: {a: 1}}
 ¦ {linspace: [0, 1, 3]} ¦ !!str 1 ¦ {share: 0.5} ¦ {1: 2} ¦ none ¦ [1, 0, 1] ¦ {random: 3}
 ¦ '\\ud800'
 ¦ \t ¦ star ¦ rotating ¦ {kind: file, path: /dev/null}""".replace("\n", "").split(" ¦ ")
WORDS += ["9" * 400, "0x" + "f" * 99]
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
    for _ in range(60):
        text = mutated(random)
        (tmp_path / "bad.yaml").write_text(text)
        try:
            jaxnet.load(tmp_path / "bad.yaml")
        except jaxnet.ConfigError as error:
            outcomes[False] += len(str(error).splitlines()) == len(error.problems)
        else:
            outcomes[True] += 1
    assert sum(outcomes.values()) == 60
    assert min(outcomes.values()) > 5


EXTREMES = r"""horizon: 1e300\noutput_step: 1e-300
tick: 1e-320
horizon: NINES
gain: LISTS
vehicles: 99999999999999999999\nattack: none
defence: {theta: 99999999999999999999}
save: {trajectories: {samples: [99999999999999999999]}}
sweep: {attack.magnitude: {linspace: [-1e308, 1e308, 3]}}
navigator: {amplitude: [1e200, 1e200], frequency: [1e100, 1e100]}
topology: {kind: edges, edges: [[1, 0, 1e308], [1, 2, 1e308]]}"""
EXTREMES = EXTREMES.replace("NINES", "9" * 5000).replace("LISTS", "[" * 3000 + "]" * 3000)


@pytest.mark.parametrize("text", EXTREMES.splitlines(), ids=lambda text: text[:30])
def test_extremes_end_without_a_traceback(text: str, tmp_path: Path):
    result = check(tmp_path / "bad.yaml", f"name: bad\n{unescaped(text)}\n")
    assert result.exception is None or isinstance(result.exception, SystemExit), result.exception
    assert result.exit_code in (0, 2)


# --- good ones ------------------------------------------------------------------------------------


def load(tmp_path: Path, text: str, *overrides: str):
    """The study of a text; `jaxnet check` must be content with it too."""
    path = tmp_path / "good.yaml"
    result = check(path, text, overrides)
    assert result.exception is None, result.stderr or repr(result.exception)
    after = f"next: {shlex.join(['jaxnet', 'run', str(path), *overrides])}\n"
    assert (result.exit_code, result.stderr) == (0, after)
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
        "horizon: 30.00000001",  # 1e-9 relative is let pass
        "horizon: 5\ntail: 5",
        "tail: 0\ntick: 0",
        "gain: [{uniform: [0.1, 8.9]}, {choice: [3, 4]}, {normal: [3, 0]}]",
        "topology: {navigator_weight: {uniform: [1e-9, 0.999]}}",
        "engine: {rtol: {uniform: [1e-9, 0.999]}, atol: {normal: [1e-9, 0]}}",
        "defence: {trusted: {1: [0, 12]}, theta: {12: 0}}\nseed: 9223372036854775807",
        "attack: {magnitude: {uniform: [0, 0]}}\ninitial: {speed: {normal: [1, 0]}}",
        "samples: 4\nsave: {trajectories: {samples: [0, 3]}}",
        "vehicles: 1\nattack: none\ntopology: star\nsweep: {}",
        "sweep: {topology: [star, path]}\nsave: {errors: true, trajectories: {worst: 1}}",
    ],
)
def test_what_only_just_holds_is_accepted(text: str, tmp_path: Path):
    load(tmp_path, f"name: good.one-2_3\n{text}\n")


@pytest.mark.parametrize(
    ("text", "overrides", "key", "value"),
    [
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


MAGNITUDES = "sweep: {attack.magnitude: [0, 5]}"
FANS = (
    "vehicles: 2\nattack: none\nsweep:\n  topology:\n"
    "    - {kind: edges, edges: [[1, 0, 1], [2, 0, 1]], label: fan}\n"
    "    - {kind: edges, edges: [[1, 0, 1], [2, 1, 1]]}\n    - path"
)


@pytest.mark.parametrize(
    ("text", "override", "labels"),
    [
        ("", "seed=0", ""),
        (
            "sweep: {topology: [star, path], attack.magnitude: [0, 5]}",
            "seed=0",
            "star, 0; star, 5; path, 0; path, 5",
        ),
        ("sweep: {attack: [bias], attack.direction: [1.5]}", "seed=0", "bias, 1.5"),
        (
            "sweep: {defence: [none, trusted_trim, {theta: 2}]}",
            "seed=0",
            "none; trusted_trim(theta=1); trusted_trim(theta=2)",
        ),
        (
            "sweep: {defence: [{theta: 1, label: weak}, {theta: 2}]}",
            "seed=0",
            "weak; trusted_trim(theta=2)",
        ),
        (FANS, "seed=0", "fan; edges; path"),
        ("sweep: {attack.magnitude: {linspace: [0, 1, 3]}}", "seed=0", "0.0; 0.5; 1.0"),
        (MAGNITUDES, "sweep.attack.magnitude={geomspace: [1, 4, 3]}", "1; 2; 4"),
        (MAGNITUDES, "sweep.attack.magnitude=[0, {uniform: [0, 1]}]", '0; {"uniform": [0, 1]}'),
        ("sweep: {attack.phase.uniform: [[0, 1]]}", "seed=0", "[0, 1]"),
        ("sweep: {attack.vehicles: [[2], [2, 5]]}", "seed=0", "[2]; [2, 5]"),
    ],
)
def test_cells_and_their_labels(text: str, override: str, labels: str, tmp_path: Path):
    study = load(tmp_path, f"name: good\n{text}\n", override)
    told = [", ".join(map(str, cell.labels.values())) for cell in study.cells]
    assert "; ".join(told) == labels


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
