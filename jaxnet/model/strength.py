"""Strength of a row of weights: how strongly a vehicle follows those it hears, under a local law.

A vehicle follows the mean of those it retains, `q_i = s_i (a0 y_0^(r) - P(ε_i))`. The strength s_i
is 1 unless the network says otherwise. Let S be the share of the row's weights that the vehicle
retains.

    with a weight on itself    s = S / (S + w_ii / Σ_j w_ij): the retained weights and w_ii sum to 1
    with weights as they are   s = S Σ_j w_ij: the Laplacian's form, q_i = -Σ_j w_ij P(y_i - y_j)

The exact law and its rounds solve `L q = b`, which does not depend on the strength of a row.
"""

from typing import Any, NamedTuple

from jaxtyping import Float

from jaxnet.model.shapes import Numbers

RowShares = Float[Any, "axes m *lanes"]


class WithOwnWeight(NamedTuple):
    """Strength of rows in which a vehicle has a weight on itself."""

    own: Numbers  # w_ii over the sum of the other weights, (m, lanes)

    def of(self, retained: RowShares) -> RowShares:
        """The strength of rows of which this share of the weights is retained."""
        total = retained + self.own[None]
        return retained / total.__array_namespace__().where(total > 0, total, 1.0)


class WeightsAsTheyAre(NamedTuple):
    """Strength of rows whose weights are not normalised."""

    total: Numbers  # Σ_j w_ij, (m, lanes)

    def of(self, retained: RowShares) -> RowShares:
        return self.total[None] * retained


RowStrength = WithOwnWeight | WeightsAsTheyAre
