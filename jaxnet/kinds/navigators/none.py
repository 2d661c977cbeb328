from jaxnet.kinds.kind import Fault
from jaxnet.kinds.navigators import Navigator


class NoNavigator(Navigator):
    """Nobody leads: links from the navigator do not exist, the other weights of a row sum to 1.

    Needs `law: local`. The error of a vehicle is its distance from the mean of the vehicles that
    are not attacked. Rows also have the metrics `spread` and `outside`, which measure agreement and
    safety, and `recovery` asks for the spread. A link that is replaced carries the attack's signal
    alone.
    """

    words = "no navigator"
    present = False

    def jets(self, time):
        xp = time.__array_namespace__()
        return xp.zeros((4, 2, *time.shape))

    def faults(self, scenario):
        if scenario.law.couples():
            message = "without a navigator the law has no solution: give law: local"
            yield Fault(("navigator", "law"), message)
