"""What a page does whose workbench is gone: it says so, instead of trying to connect for ever.

A server that is only busy does not answer at once, and the page waits; one that has ended refuses the connection, and
one that was started anew refuses the token of the old page.
"""

import html
import json
import shlex
from pathlib import Path

LOOK = 2000  # ms, between two looks whether the page is connected
MANY = 3  # looks in a row that find no workbench


def watch_script(folder: Path) -> str:
    """The script as HTML; it says with which command the workbench on this folder is started."""
    command = f"edhas workbench {shlex.quote(str(folder))}"
    text = (
        "<b>This workbench has ended or was started anew.</b> The page shows what it was before, and its buttons do "
        f"nothing. Start <code>{html.escape(command)}</code> and open the address that it prints."
    )
    return f"""<script>(() => {{
  let missed = 0;
  const timer = setInterval(async () => {{
    if (!window.socket || window.socket.connected) {{ missed = 0; return }}
    const gone = await fetch('/alive', {{cache: 'no-store'}}).then(answer => answer.status === 403, () => true);
    missed = gone && !window.socket.connected ? missed + 1 : 0;
    if (missed < {MANY}) return;
    clearInterval(timer);
    window.socket.io.reconnection(false);
    window.socket.disconnect();
    document.getElementById('popup').ariaHidden = true;
    const note = document.createElement('div');
    note.className = 'wb-ended';
    note.dataset.mark = 'ended';
    note.setAttribute('role', 'alert');
    note.innerHTML = {json.dumps(text)};
    document.body.append(note);
  }}, {LOOK});
}})()</script>"""
