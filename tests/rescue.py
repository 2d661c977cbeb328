"""SASLabStevens/rescue, exp1, in plain NumPy: observers of neighbourhoods cut off two liars.

Source: Bahrami and Jafarnejadsani, arXiv 2410.04547. Agents have the numbers 0 to 7 there.
"""

import numpy as np

AGENTS, LIARS, STEP, ALPHA, GAMMA, APART = 8, (4, 5), 0.01, 1.0, 3.0, 0.95
FIRST = [(0, 4), (0, 5), (1, 5), (2, 3), (2, 6), (2, 7), (3, 7), (4, 5), (6, 7)]
SECOND = [(0, 6), (1, 3), (1, 4), (1, 7), (2, 4), (4, 6), (4, 7), (5, 6), (5, 7)]


def adjacency(edges):
    A = np.zeros((AGENTS, AGENTS))
    for i, j in edges:
        A[i, j] = A[j, i] = 1.0
    return A


def laplacian(A):
    return np.diag(A.sum(axis=1)) - A


def in_force(step):
    """The first network while t mod 1 is at most 0.5; it changes at 0.51, 1, 1.51, … s."""
    return adjacency(FIRST if step % 100 <= 50 else SECOND)


class Observer:
    """What an agent expects of itself, its neighbours and theirs."""

    def __init__(self):
        self.ids, self.state = [], np.zeros(0)

    def step(self, i, A, p, v):
        """Advance by the positions of a step. It starts anew where others are around than before.

        Returns the expected positions of the neighbours.
        """
        near = np.flatnonzero(A[i]).tolist()
        far = np.setdiff1d(np.flatnonzero(A[near].any(axis=0)), [i, *near]).tolist()
        n = 1 + len(near) + len(far)
        if self.ids != [i, *near, *far]:
            self.ids = [i, *near, *far]
            self.state = np.concatenate([p[self.ids], [v[i]], np.zeros(n - 1)])
        links = A[np.ix_(self.ids, self.ids)]
        links[n - len(far) :, n - len(far) :] = 0.0
        L, first = laplacian(links), np.eye(n)[0]
        H = ALPHA * ((L.diagonal().max() + 2) * np.eye(n) - np.diag(L.diagonal()))
        below = np.hstack([-ALPHA * L - H, -GAMMA * np.eye(n) - 2 * np.outer(first, first)])
        rate = np.vstack([np.hstack([np.zeros((n, n)), np.eye(n)]), below]) @ self.state
        rate[n:] += H @ p[self.ids] + 2 * first * v[i]
        self.state = self.state + STEP * rate
        return dict(zip(near, self.state[1:], strict=False))


def run(horizon, monitors=(), signals=(0.3, 0.5)):
    """Positions (steps + 1, 8), and alarms (t, who, whom) of the agents that monitor.

    An alarm compares the position of a step with what is expected after it, and cuts a link both
    ways from the next step on. The input of a liar is its signal times t; without signals all obey.
    """
    p, v, kept = np.arange(1.0, AGENTS + 1), np.zeros(AGENTS), np.ones((AGENTS, AGENTS))
    observers, places, alarms = {i: Observer() for i in monitors}, [p], []
    for step in range(round(horizon / STEP)):
        A = in_force(step) * kept
        u = -ALPHA * laplacian(A) @ p - GAMMA * v
        if len(signals):
            u[list(LIARS)] = np.array(signals) * step * STEP
        for i, observer in observers.items():
            for j, place in observer.step(i, A, p, v).items():
                if abs(p[j] - place) > APART:
                    alarms.append((round(step * STEP, 2), i, j))
                    kept[i, j] = kept[j, i] = 0.0
        p, v = p + STEP * v, v + STEP * u
        places.append(p)
    return np.array(places), alarms
