"""A local page that replays a recorded run over a WebSocket. Needs the extra ``dashboard``.

Importing this package loads no web server; the first application does.
"""

from trigpoint.dashboard.app import page_url, replay_app, serve
from trigpoint.dashboard.frames import decode_frame, frame, topology_message
from trigpoint.dashboard.playback import Playback

__all__ = ["Playback", "decode_frame", "frame", "page_url", "replay_app", "serve", "topology_message"]
