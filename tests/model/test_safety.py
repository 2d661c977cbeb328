"""Who is safe: by enumeration on small digraphs. What they announce: theory/test_announced.py."""

import itertools

import numpy as np

from jaxnet.kinds.attacks.bias import Bias
from jaxnet.kinds.defences.clipping import Clipping
from jaxnet.kinds.defences.trusted_only import TrustedOnly
from jaxnet.kinds.defences.trusted_trim import TrustedTrim
from jaxnet.model import graph, safety
from tests.matrices import slotwise

VEHICLES = 5
EVERYONE = range(1, VEHICLES + 1)
SETS = [set(s) for n in range(VEHICLES + 1) for s in itertools.combinations(EVERYONE, n)]


def scenario(seed, m=VEHICLES):
    """A digraph of five vehicles, attacked and trusted links, and ϑ of each."""
    rng = np.random.default_rng(seed)
    shape = (m, m + 1)
    heard = rng.random(shape) < rng.uniform(0.3, 0.9)
    heard[range(m), range(1, m + 1)] = False
    heard[:, 0] |= ~heard.any(axis=1)
    liars = np.concatenate([[False], rng.random(m) < 0.3])
    attacked = heard & (liars | (rng.random(shape) < 0.1))
    trusted = heard & (rng.random(shape) < 0.25)
    trusted[:, 0] = heard[:, 0]
    return heard, attacked, trusted, rng.integers(0, 3, m)


def drops_of(heard, trusted, theta):
    """Who is dropped by whoever announces and trims, with equal weights."""
    network = graph.normalised(graph.of_matrix(heard))
    each = {i: int(n) for i, n in enumerate(theta, 1)}
    return (
        TrustedTrim(score="announced", theta=each)
        .retained(network, slotwise(network, trusted))
        .believed()
    )


def greatest(drops, attacked):
    """The greatest set, for attacked links as a matrix."""
    return safety.greatest(drops, slotwise(drops.graph, attacked), drops.number)


def closed(inside, heard, attacked, trusted, theta):
    """Whether a set of vehicles (from 1) hears nobody outside and meets A1 to A3, word by word."""
    sources = {i: believed(heard[i - 1], trusted[i - 1], theta[i - 1]) for i in EVERYONE}
    trims = {i: heard[i - 1].sum() > theta[i - 1] for i in EVERYONE}
    for i in inside:
        outside = sources[i] - inside - {0}
        bad = {j for j in sources[i] if attacked[i - 1, j]} | outside
        if len(bad) > (theta[i - 1] if trims[i] else 0) or any(trusted[i - 1, j] for j in bad):
            return False
        if outside:
            return False
    there = {0}
    for _ in EVERYONE:
        for i in inside:
            known = sources[i] & there
            doubted = {j for j in known if not trusted[i - 1, j]}
            if known - doubted or (known and not trims[i]) or len(doubted) > theta[i - 1]:
                there.add(i)
    return inside <= there


def believed(heard, trusted, theta):
    """Sources that are not dropped for good, as the untrusted are of whom there are at most ϑ."""
    for_good = heard.sum() > theta and (heard & ~trusted).sum() <= theta
    return set(np.flatnonzero(heard & trusted if for_good else heard))


def numbers(mask):
    return set(np.flatnonzero(mask) + 1)


def test_it_is_the_greatest_set_that_meets_the_assumptions():
    """Found by trying all 32 sets; a union of two such sets is one, so that there is a greatest."""
    for seed in range(60):
        heard, attacked, trusted, theta = given = scenario(seed)
        known = set().union(*(s for s in SETS if closed(s, *given)))
        drops = drops_of(heard, trusted, theta)
        assert numbers(greatest(drops, attacked)) == known


def test_what_the_literature_asks_for_is_more():
    """Closed sets reached by percolation (2ϑ + 1 heard or ϑ + 1 trusted) are safe by majority."""
    found = 0
    for seed in range(200):
        heard, attacked, trusted, theta = scenario(seed)
        given = heard, attacked, trusted & ~attacked, theta
        safe = numbers(greatest(drops_of(heard, given[2], theta), attacked))
        percolated = [inside for inside in SETS if percolates(inside, *given)]
        found += sum(map(len, percolated))
        assert all(inside <= safe for inside in percolated)
    assert found > 20


def percolates(inside, heard, attacked, trusted, theta):
    """Whether a set hears nobody outside, no member more than ϑ liars, and many reach it."""
    sources = {i: believed(heard[i - 1], trusted[i - 1], theta[i - 1]) for i in inside}
    if any(sources[i] - inside - {0} or attacked[i - 1].sum() > theta[i - 1] for i in inside):
        return False
    there = {0}
    for _ in EVERYONE:
        for i in inside:
            known = sorted(sources[i] & there)
            if len(known) > 2 * theta[i - 1] or trusted[i - 1, known].sum() > theta[i - 1]:
                there.add(i)
    return inside <= there


def test_who_stays_joined_is_reached_whoever_is_dropped():
    """By trying all choices of four vehicles; who does not is cut off by one of them."""
    for seed in range(40):
        heard, _, trusted, theta = scenario(seed, 4)
        drops = drops_of(heard, trusted, theta)
        lost = [graph.unreachable(drops.graph.only(~dropped)) for dropped in attacks(drops)]
        assert numbers(~safety.stay_joined(drops, np.ones(4, bool))) == set().union(*map(set, lost))


def attacks(drops):
    """All attacks on as many droppable links of each listener as it drops."""
    rows = []
    for links, number in zip(drops.links, drops.number, strict=True):
        sources = np.flatnonzero(links)
        some = itertools.combinations(sources, int(min(number, len(sources))))
        rows.append([np.isin(np.arange(len(links)), each) for each in some])
    return (np.stack(each) for each in itertools.product(*rows))


PATH = graph.weighted(VEHICLES, [(i, i - 1, 1.0) for i in EVERYONE])
LOOP = graph.weighted(3, [(i, j, 1.0) for i, j in ((1, 0), (2, 1), (2, 3), (3, 1), (3, 2))])


def reasons(defence, weights, attacked=()):
    """Vehicles by reason."""
    links = Bias(vehicles=list(attacked)).attacked_links(weights)
    found = defence.safe(weights, links, defence.trusts(weights))
    return {each.why.partition(",")[0]: numbers(each.vehicles) for each in found}


def test_who_hears_no_attacked_link_however_far_upstream_is_untouched():
    """A path of five whose third transmits falsely."""
    assert reasons(TrustedTrim(), PATH, [3])["untouched"] == {1, 2, 3}
    assert reasons(TrustedTrim(score="announced"), PATH, [3])["by majority"] == {1, 2, 3}


def test_who_may_be_cut_off_is_not_safe():
    """2 and 3 may each drop 1 and believe each other, unattacked: then nothing is determined."""
    announced = TrustedTrim(score="announced", theta={2: 1, 3: 1})
    assert set().union(*reasons(announced, LOOP).values()) == {1}
    assert reasons(Clipping(), LOOP)["untouched"] == {1, 2, 3}
    pair = TrustedOnly(trusted={2: [3], 3: [2]})
    assert reasons(pair, LOOP)["by trust"] == {1}
    assert reasons(TrustedOnly(trusted={2: [1], 3: [2]}), LOOP, [3]) == {
        "untouched": {1},
        "by trust": {1, 2, 3},
    }


def test_what_is_filtered_proves_nothing():
    """The theorem is of what is announced at the tick."""
    star = graph.weighted(1, [(1, 0, 1.0)])
    filtered = reasons(TrustedTrim(score="announced", filter=1.0), star)
    assert set(filtered) == {"untouched", "by trust"}
