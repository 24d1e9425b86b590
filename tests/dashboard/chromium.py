"""A real Chromium, driven through its DevTools protocol over ``websockets``; used by tests, a benchmark, a picture."""

from __future__ import annotations

import base64
import json
import os
import shutil
import subprocess
import tempfile
import time
from contextlib import ExitStack, suppress
from pathlib import Path

import psutil
from websockets.sync.client import connect

NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
FLAGS = (
    "--headless=new",
    "--remote-debugging-port=0",
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--disable-dev-shm-usage",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-default-apps",
    "--disable-extensions",
    "--disable-sync",
    "--hide-scrollbars",
    "--metrics-recording-only",
    "--mute-audio",
    "--no-default-browser-check",
    "--no-first-run",
)
PATIENCE = 60.0


STANDS = """new Promise(done => {
  const element = document.querySelector(%s);
  let last = '', same = 0;
  const look = () => {
    element.scrollIntoView({block: 'center'});
    const box = element.getBoundingClientRect(), now = [box.x, box.y, box.width, box.height].join();
    same = now === last ? same + 1 : 0;
    last = now;
    if (same >= 2) done([box.x + box.width / 2, box.y + box.height / 2]);
    else requestAnimationFrame(look);
  };
  look();
})"""
"""The middle of an element, once it has stood still for two frames: what comes in may still move it."""


def executable() -> str:
    """Path of the browser."""
    found = next((path for name in NAMES if (path := shutil.which(name))), None)
    assert found, f"none of {', '.join(NAMES)} is on the PATH; install one (Debian: apt-get install chromium)"
    return found


class Chromium:
    """A browser process with a profile of its own; a context manager."""

    def __init__(self, width=1280, height=800, dark=False):
        self._size, self._dark = (width, height), dark

    def __enter__(self):
        with ExitStack() as stack:
            self._profile = stack.enter_context(tempfile.TemporaryDirectory(ignore_cleanup_errors=True))
            self._process = self._start()
            stack.callback(self._kill)
            self._socket = stack.enter_context(connect(self._address(), max_size=None, proxy=None))
            self._stack = stack.pop_all()
        self._count, self._waiting = 0, []
        return self

    def __exit__(self, *_):
        self._stack.close()

    def _start(self):
        sandbox = ("--no-sandbox",) if os.geteuid() == 0 else ()  # Chromium's sandbox refuses root
        size = f"--window-size={self._size[0]},{self._size[1]}"
        command = [executable(), *FLAGS, *sandbox, size, f"--user-data-dir={self._profile}", "about:blank"]
        quiet = subprocess.DEVNULL
        return subprocess.Popen(command, stdin=quiet, stdout=quiet, stderr=quiet, start_new_session=True)

    def processor_seconds(self):
        """What the browser's processes that run have used so far."""
        own = psutil.Process(self._process.pid)
        while True:
            with suppress(psutil.NoSuchProcess):  # one that ends meanwhile is in the account of its parent then
                return sum(sum(one.cpu_times()[:4]) for one in (own, *own.children(recursive=True)))

    def _kill(self):
        self._process.kill()
        self._process.wait()

    def _address(self):
        told = Path(self._profile) / "DevToolsActivePort"
        until = time.monotonic() + PATIENCE
        while time.monotonic() < until:
            assert self._process.poll() is None, f"the browser ended with {self._process.returncode}"
            lines = told.read_text("utf-8").split() if told.exists() else []
            if len(lines) == 2:
                return f"ws://127.0.0.1:{lines[0]}{lines[1]}"
            time.sleep(0.02)
        raise AssertionError("the browser did not open its DevTools port")

    def call(self, method, session=None, **params):
        """Result of one DevTools command; events that come meanwhile are kept for ``events``."""
        self._count += 1
        message = {"id": self._count, "method": method, "params": params}
        self._socket.send(json.dumps(message if session is None else {**message, "sessionId": session}))
        until = time.monotonic() + PATIENCE
        while True:
            answer = json.loads(self._socket.recv(timeout=max(0.0, until - time.monotonic())))
            if answer.get("id") != self._count:
                self._waiting.append(answer)
                continue
            assert "error" not in answer, f"{method}: {answer.get('error')}"
            return answer["result"]

    def events(self, session):
        """Events of a page so far."""
        return [event for event in self._waiting if event.get("sessionId") == session]

    def open(self, url):
        """A page at ``url``, with everything that it asks for and complains about recorded."""
        target = self.call("Target.createTarget", url="about:blank")["targetId"]
        session = self.call("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        page = Page(self, session, target)
        for domain in ("Page", "Runtime", "Log", "Network"):
            page.call(f"{domain}.enable")
        scheme = [{"name": "prefers-color-scheme", "value": "dark" if self._dark else "light"}]
        page.call("Emulation.setEmulatedMedia", features=scheme)
        width, height = self._size
        page.call("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=False)
        page.call("Page.navigate", url=url)
        return page


class Page:
    """One tab."""

    def __init__(self, browser, session, target):
        self._browser, self._session, self._target = browser, session, target

    def call(self, method, **params):
        return self._browser.call(method, self._session, **params)

    def close(self):
        self._browser.call("Target.closeTarget", targetId=self._target)

    def run(self, script):
        """Value of a JavaScript expression; what it throws fails."""
        answer = self.call("Runtime.evaluate", expression=script, returnByValue=True, awaitPromise=True)
        assert "exceptionDetails" not in answer, f"{script}: {answer['exceptionDetails']}"
        return answer["result"].get("value")

    def until(self, script, seconds=PATIENCE):
        """Value of the expression once it is true."""
        end = time.monotonic() + seconds
        while not (value := self.run(script)):
            assert time.monotonic() < end, f"never true: {script}; the page complains: {self.complaints()}"
            time.sleep(0.03)
        return value

    def state(self):
        """What the page's hook for tests tells."""
        return self.run("trigpoint.state()")

    def ready(self):
        """Waits for the first drawn frame."""
        self.until("typeof trigpoint === 'object' && trigpoint.state().received > 0 && trigpoint.state().draws > 0")
        return self

    def painted(self):
        """Waits until what was drawn is on the screen."""
        self.run("new Promise(done => requestAnimationFrame(() => requestAnimationFrame(() => done(true))))")

    def click(self, x, y):
        for kind in ("mouseMoved", "mousePressed", "mouseReleased"):
            held = {} if kind == "mouseMoved" else {"button": "left", "clickCount": 1}
            self.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, **held)

    def point(self, x, y):
        self.call("Input.dispatchMouseEvent", type="mouseMoved", x=x, y=y)

    def press(self, key, code=0):
        for kind in ("keyDown", "keyUp"):
            self.call("Input.dispatchKeyEvent", type=kind, key=key, windowsVirtualKeyCode=code)

    def click_element(self, selector):
        self.click(*self.run(STANDS % json.dumps(selector)))

    def click_node(self, node):
        place = self.run(f"trigpoint.at({node})")
        self.click(place["x"], place["y"])

    def requests(self):
        """Addresses that the page has asked for."""
        events = self._browser.events(self._session)
        plain = [e["params"]["request"]["url"] for e in events if e["method"] == "Network.requestWillBeSent"]
        sockets = [e["params"]["url"] for e in events if e["method"] == "Network.webSocketCreated"]
        return plain + sockets

    def complaints(self):
        """Errors and warnings of the console, exceptions, refusals of the policy."""
        found = []
        for event in self._browser.events(self._session):
            params = event["params"]
            if event["method"] == "Runtime.exceptionThrown":
                found.append(params["exceptionDetails"].get("exception", {}).get("description", str(params)))
            if event["method"] == "Log.entryAdded" and params["entry"]["level"] in ("error", "warning"):
                found.append(f"{params['entry']['text']} {params['entry'].get('url', '')}")
            if event["method"] == "Runtime.consoleAPICalled" and params["type"] in ("error", "warning", "assert"):
                found.append(str([argument.get("value") for argument in params["args"]]))
        return found

    def screenshot(self, path=None):
        """The page as PNG bytes, written to ``path`` if it is given."""
        data = base64.b64decode(self.call("Page.captureScreenshot", format="png")["data"])
        if path is not None:
            Path(path).write_bytes(data)
        return data
