"""What a diagnosis says of a candidate, how strong the evidence for it is, and when much is left: in words."""

import enum
import math

MUCH_LEFT = 2.0  # residual over noise: from here on a model does not describe the measurements, and the answer says so
# log evidence [nats] below which it is called so
EVIDENCE_WORDS = ((3.0, "weak"), (12.0, "clear"), (100.0, "strong"), (math.inf, "overwhelming"))
RAISED = str.maketrans("0123456789", "⁰¹²³⁴⁵⁶⁷⁸⁹")


class Outcome(enum.Enum):
    """What a diagnosis says of a candidate that it has fitted."""

    MISSING = "missing"  # it is in the best set
    POSSIBLE = "possibly missing"  # it is in a set that the measurements do not tell from the best one
    TRIED = "tried"  # it is in less probable sets only

    @property
    def is_quiet(self) -> bool:
        """Whether it is shown in grey: it is probably nothing."""
        return self is Outcome.TRIED


def evidence_text(gain: float) -> str:
    """How strongly the runs speak for a model with something more, in words with the rounded number.

    Args:
        gain: of log evidence or log weight [nats]; NaN or infinite where there is none.
    """
    if not math.isfinite(gain) or abs(gain) < 1.0:
        return "none"
    word = "against it" if gain < 0.0 else next(word for limit, word in EVIDENCE_WORDS if gain < limit)
    return f"{word} ({_rounded(gain)} nats)"


def _rounded(value: float) -> str:
    """Two significant digits, large numbers with a power of ten: "34", "1.3·10⁶"."""
    mantissa, exponent = f"{value:.1e}".split("e")
    if int(exponent) < 4:
        return f"{float(f'{value:.2g}'):g}".replace("-", "−")
    return f"{mantissa}·10{str(int(exponent)).translate(RAISED)}".replace("-", "−")
