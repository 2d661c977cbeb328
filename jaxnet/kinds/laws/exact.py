from jaxnet.kinds.laws import Law


class ExactLaw(Law):
    """The paper's law, solved for all vehicles at every instant, as if each knew all jerks."""

    holds = False
