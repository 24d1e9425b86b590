"""Many live nodes on one machine: what a step and a link cost, how many deadlines are missed, whether memory stays.

Run: OPENBLAS_NUM_THREADS=1 python benchmarks/live.py [agents] [rate in Hz] [seconds] [agents in a process]
"""

import math
import os
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from trigpoint.cli.choices import method_of
from trigpoint.cli.compose import part_of, read_any
from trigpoint.cli.live import LiveRun
from trigpoint.cli.live_plan import Design, Places, plan_of
from trigpoint.methods import design
from trigpoint.runtime import Kind, encode_frame

WARM = 5.0


def scenario(agents, rate):
    rows = max(k for k in range(1, math.isqrt(agents) + 1) if agents % k == 0)
    return f"""
[network]
gallery = {{ kind = "grid", rows = {rows}, cols = {agents // rows}, anchors = [0] }}
[simulate]
initial_state = 1.0
noise = {{ measurement = 0.01 }}
[run]
rate = {rate}
"""


def main(agents=200, rate=10.0, seconds=60.0, together=50):
    with tempfile.TemporaryDirectory(prefix="tp-") as folder:
        path = Path(folder) / "many.toml"
        path.write_text(scenario(agents, rate), encoding="utf-8")
        (Path(folder) / "watch").mkdir()
        given = read_any(path)
        part = part_of(given, given.design)
        found = Design(given, part, given.design, design(part.problem, method_of(given.design, part.problem)))
        section = given.run.model_copy(update={"agents_per_process": together})
        plan = plan_of(found, section, Places(Path(folder), Path(folder)))
        return measured(LiveRun(plan, None), seconds)


def measured(live, seconds):
    """Figures of the time after everybody has been heard for five seconds."""
    sizes, marks = [], []
    live.monitor.hooks.append(
        lambda frame, _: sizes.append(len(encode_frame(frame))) if frame.kind is Kind.ESTIMATE else None
    )

    def mark(snapshot):
        everybody = bool((snapshot.age < 2.0).all())
        start = marks[0][0] + (WARM if len(marks) == 1 else 0.0) if marks else -math.inf
        if everybody and (len(marks) < 2 and snapshot.time >= start):
            marks.append(look(snapshot))

    def look(snapshot):
        statuses = [status for status in snapshot.status if status is not None]
        usage = live.supervisor.usage()
        nodes = usage[: len(live.plan.groups)]
        return (
            snapshot.time,
            sum(status.acts for status in statuses),
            sum(status.missed for status in statuses),
            sum(one.cpu for one in nodes),
            sum(one.memory for one in nodes),
            float(np.mean([status.step_us for status in statuses])) if statuses else math.nan,
            len(sizes),
            sum(sizes),
            usage[-1].cpu,
            time.process_time(),
        )

    last = live.follow(seconds + WARM + 10.0, mark)
    assert len(marks) == 2, f"not everybody was heard for {WARM:g} s"
    first, final = marks[1], look(last)
    lasted, acts, missed, cpu, memory, _, frames, amount, plant, own = (
        b - a for a, b in zip(first, final, strict=True)
    )
    count = len(live.plan.names)
    busy = cpu / lasted
    return {
        "agents": count,
        "processes": len(live.plan.groups),
        "seconds": lasted,
        "share of deadlines missed": missed / max(acts + missed, 1),
        "microseconds a step": final[5],
        "processor time a step, microseconds": 1e6 * cpu / max(acts, 1),
        "agents a core": count / busy,
        "cores of the plant": plant / lasted,
        "cores of the monitor and supervisor": own / lasted,
        "load of the machine": os.getloadavg()[0],
        "estimates a second and node": frames / lasted / count,
        "bytes a second on a link, each way": amount / lasted / count,
        "memory of all nodes, MB": final[4] / 2**20,
        "growth of memory": memory / first[4],
        "anchored": sum(status.anchored for status in last.status if status is not None),
    }


if __name__ == "__main__":
    given = [float(text) for text in sys.argv[1:]]
    figures = main(*(int(given[k]) if k in (0, 3) else given[k] for k in range(len(given))))
    for name, value in figures.items():
        print(f"{name:40s} {value:12.5g}")
