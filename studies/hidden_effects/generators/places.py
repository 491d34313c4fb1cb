"""Which valve or chamber an equation belongs to, for what differs between parts that the machine has twice."""

from edhas_jax.machine.interface.signals import Signals


def valve_of(s: Signals) -> str:
    """The valve whose equation is being evaluated: "suction_a", "delivery_a", "suction_b" or "delivery_b".

    The equations set the flow of a valve after its acceleration, in this order.
    """
    known = s.values()
    return next(v for v in ("suction_a", "delivery_a", "suction_b", "delivery_b") if _lift_of(v) not in known)


def _lift_of(valve: str) -> str:
    kind, side = valve.split("_")
    return f"{kind}_lift_{side}"


def is_chamber_b(s: Signals) -> bool:
    """Whether the equation of an oil node or of a leakage is that of chamber B."""
    known = s.values()
    return known.get("chamber_pressure", known.get("pressure")) is known["chamber_pressure_b"]
