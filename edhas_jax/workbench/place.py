"""A place on the page: the view, and what is looked at in it; written behind the # of the address of the page."""

import dataclasses
import urllib.parse


@dataclasses.dataclass(frozen=True)
class Place:
    """A place on the page; empty where nothing was chosen.

    Attributes:
        view: name of the view.
        run: the run, for all views.
        signal: the signal, for all views.
        model: the model that is compared.
        part: the part of the machine.
    """

    view: str = ""
    run: str = ""
    signal: str = ""
    model: str = ""
    part: str = ""

    @property
    def address(self) -> str:
        """The place as the last part of an address, from its # on."""
        chosen = {name: value for name, value in dataclasses.asdict(self).items() if value and name != "view"}
        return f"#{urllib.parse.quote(self.view)}" + (f"?{urllib.parse.urlencode(chosen)}" if chosen else "")

    @classmethod
    def read(cls, address: str) -> "Place":
        """The place of an address; what it does not name, or names wrongly, is empty."""
        view, _, chosen = address.removeprefix("#").partition("?")
        names = {field.name for field in dataclasses.fields(cls)} - {"view"}
        found = {name: value for name, value in urllib.parse.parse_qsl(chosen) if name in names}
        return cls(urllib.parse.unquote(view), **found)
