"""What the calculating process does for the page: one method for each question, with plain data as the answer."""

from collections.abc import Callable
from pathlib import Path

from edhas_jax.core.runtime import keep_xla_programs
from edhas_jax.workbench.campaign_calculations import CampaignCalculations
from edhas_jax.workbench.data_calculations import DataCalculations
from edhas_jax.workbench.design_calculations import DesignCalculations
from edhas_jax.workbench.fit_calculations import FitCalculations
from edhas_jax.workbench.workspace import Workspace


class Calculations:
    """Everything that the page asks for, by topic.

    Args:
        folder: the folder of the workspace.
        say: called with a sentence on the progress.

    Attributes:
        campaign: comparison of models with the measurements, trials of effects.
        data: files that were dropped, and the check of the campaign.
        design: runs and sweeps of a machine.
        fit: the choices for a fit, where one stands that runs, how certain one is.
    """

    def __init__(self, folder: Path, say: Callable[[str], None]):
        keep_xla_programs()
        self._workspace = workspace = Workspace(folder)
        self.campaign = CampaignCalculations(workspace, say)
        self.data = DataCalculations(workspace, say)
        self.design = DesignCalculations(workspace, say)
        self.fit = FitCalculations(workspace, self.campaign, say)

    def answer(self, name: str, arguments: tuple, allowed: list[str]):
        """The answer to one question, such as "campaign.compare", with the effects of files that may run."""
        self._workspace.allowed = allowed
        topic, _, method = name.partition(".")
        return getattr(getattr(self, topic), method)(*arguments)


def is_user_error(error: Exception) -> bool:
    """Whether wrong input causes an error: it is then one of this package, and its text is for the user."""
    return type(error).__module__.partition(".")[0] == __name__.partition(".")[0]
