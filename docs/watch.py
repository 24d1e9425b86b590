"""Draw docs/watch.png: a live run of 16 nodes, one of them killed. Run: python docs/watch.py docs/watch.png"""

import re
import subprocess
import sys
import tempfile
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from tests.dashboard.chromium import Chromium

SCENARIO = """
[network]
gallery = { kind = "grid", rows = 4, cols = 4, anchors = [0, 15] }
[agent]
A = [[0, 1], [-1, 0]]
C = [[1, 0]]
[design]
method = "local-kalman"
gain = "from-graph"
margin = 1.05
[simulate]
initial_error = 2.0
initial_state = 1.5
seed = 3
[run]
rate = 20
"""
CHOSEN, KILLED = "6", "9"
PROGRAM = "from trigpoint.cli import main; main()"


def main(target):
    with tempfile.TemporaryDirectory() as folder:
        scenario = Path(folder) / "oscillators.toml"
        scenario.write_text(SCENARIO, encoding="utf-8")
        command = [sys.executable, "-c", PROGRAM, "run", str(scenario), "--for", "60s", "--watch", "--out", folder]
        with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as run:
            try:
                draw(address(run.stderr), target)
            finally:
                run.terminate()


def address(lines):
    for line in lines:
        if found := re.search(r"http\S+", line):
            return found[0]
    raise SystemExit("the run did not start")


def draw(url, target):
    with Chromium(width=1360, height=1120) as browser:
        page = browser.open(f"{url}#node={KILLED}&colour=error").ready()
        page.until("document.querySelector('#tile-anchored').textContent === '16 of 16'", seconds=60)
        time.sleep(9)
        page.click_element("#order-kill")
        page.until("document.querySelector('#badge').textContent === 'silent'")
        page.click_node(int(CHOSEN))
        page.run("scrollTo(0, 0)")
        time.sleep(4)
        page.screenshot(target)
        assert page.complaints() == []


if __name__ == "__main__":
    main(sys.argv[1])
