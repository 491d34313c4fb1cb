"""What a diagnosis has done with a candidate, how strong the evidence for it is, and when much is left: in words."""

import enum
import math

MUCH_LEFT = 2.0  # residual over noise: from here on a model does not describe the measurements, and the answer says so
# log-evidence [nats] below which it is called so; a model that leaves much can gain thousands with a wrong effect
EVIDENCE_WORDS = ((3.0, "weak"), (12.0, "clear"), (100.0, "strong"), (math.inf, "overwhelming"))
RAISED = str.maketrans("0123456789", "⁰¹²³⁴⁵⁶⁷⁸⁹")


class Outcome(enum.Enum):
    """What the search has done with a candidate."""

    MISSING = "missing"  # it is in the final model, and the verdict names it
    POSSIBLE = "possibly missing"  # it is in the final model and more probable than not, but not clear enough to name
    UNLIKELY = "probably not missing"  # it improves the final model, but stands in for other causes more probably
    IMITATING = "imitates an unknown cause"  # it is in the final model, with implausible values
    REMOVED = "removed"  # it was in the model first, and the backward pass has removed it
    TRIED = "tried"  # it was fitted, and is not in the final model

    @property
    def is_quiet(self) -> bool:
        """Whether it is shown in grey: it is probably nothing."""
        return self in (Outcome.UNLIKELY, Outcome.REMOVED, Outcome.TRIED)


def evidence_text(gain: float) -> str:
    """How strongly the runs speak for a model with something more, in words with the rounded number.

    Args:
        gain: of log-evidence [nats]; NaN or infinite where there is none.
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
