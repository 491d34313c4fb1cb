"""A rich console on which every text is data: no markup, no emoji codes, nothing that a terminal would obey."""

from rich.console import Console
from rich.status import Status
from rich.text import Text

from edhas_jax.core.literal_text import terminal_text


class PlainConsole(Console):
    """A console that prints texts as they are; styles come as `Text` or as the style of a table."""

    def __init__(self, **options):
        super().__init__(highlight=False, markup=False, emoji=False, **options)

    def render_str(self, text: str, **options) -> Text:
        """See `Console.render_str`."""
        return super().render_str(terminal_text(text), **options)

    def on_broken_pipe(self) -> None:
        """See `Console.on_broken_pipe`; the command ends as it does wherever else its output has no reader."""
        raise BrokenPipeError

    def status(self, status: str, **options) -> Status:
        """See `Console.status`; texts of its `update` are data as well."""
        return _PlainStatus(_plain(status), console=self, **options)


class _PlainStatus(Status):
    def update(self, status=None, **options) -> None:
        super().update(_plain(status), **options)


def _plain(text):
    return Text(terminal_text(text)) if isinstance(text, str) else text
