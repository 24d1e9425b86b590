"""A local page that shows a run, live or recorded, over a WebSocket. Needs the extra ``dashboard``.

Importing this package loads no web server; the first application does.
"""

from trigpoint.dashboard.app import live_app, page_url, replay_app, serve, serving
from trigpoint.dashboard.feed import Event, Feed, View
from trigpoint.dashboard.frames import DESIGNED, STATES, Moment, Scene, decode_moment, encode_moment
from trigpoint.dashboard.live import LiveFeed
from trigpoint.dashboard.playback import Playback
from trigpoint.dashboard.replay import ReplayFeed

__all__ = [
    "DESIGNED",
    "STATES",
    "Event",
    "Feed",
    "LiveFeed",
    "Moment",
    "Playback",
    "ReplayFeed",
    "Scene",
    "View",
    "decode_moment",
    "encode_moment",
    "live_app",
    "page_url",
    "replay_app",
    "serve",
    "serving",
]
