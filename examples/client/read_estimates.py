"""Listen to the estimates of a running network, without Trigpoint: only Zenoh and the layout of a frame.

python read_estimates.py NETWORK ADDRESS [ADDRESS ...] [--count N] [--for SECONDS]

NETWORK is the network's name, each ADDRESS one on which a node listens, such as unixsock-stream//PATH or
tcp/127.0.0.1:7447: peers do not forward, so every node that shall be heard must be named. One line of JSON a frame.
"""

import argparse
import json
import queue
import struct
from urllib.parse import quote

import zenoh

HEAD = struct.Struct("<2sBBHHQQd")  # magic, version, kind, length of the name, count, epoch, sequence, time
FACTS = struct.Struct("<4d")  # hops, evidence, broken, uncertainty
ESTIMATE = 3


def estimate(data: bytes) -> dict[str, object] | None:
    """The estimate in these bytes, or None for anything else."""
    if len(data) < HEAD.size:
        return None
    magic, version, kind, length, count, epoch, sequence, time = HEAD.unpack_from(data)
    told = HEAD.size + length
    if (magic, version, kind) != (b"TP", 2, ESTIMATE) or len(data) != told + FACTS.size + 8 * count:
        return None
    hops, evidence, broken, uncertainty = FACTS.unpack_from(data, told)
    return {
        "node": data[HEAD.size : told].decode("utf-8"),
        "epoch": epoch,
        "sequence": sequence,
        "time": time,
        "hops": hops,
        "evidence": evidence,
        "broken": broken,
        "uncertainty": uncertainty,
        "values": list(struct.unpack_from(f"<{count}d", data, told + FACTS.size)),
    }


def session(addresses: list[str]) -> zenoh.Session:
    """A peer that connects to these addresses and to nobody else, and listens nowhere."""
    config = zenoh.Config()
    settings = {
        "mode": "peer",
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "listen/endpoints": [],
        "connect/endpoints": addresses,
        "connect/timeout_ms": -1,
        "connect/exit_on_failure": False,
    }
    for path, value in settings.items():
        config.insert_json5(path, json.dumps(value))
    return zenoh.open(config)


def main() -> None:
    parser = argparse.ArgumentParser(description="Print the estimates of a running network.")
    parser.add_argument("network")
    parser.add_argument("addresses", nargs="+", metavar="ADDRESS")
    parser.add_argument("--count", type=int, default=0, help="end after so many estimates")
    parser.add_argument("--for", type=float, default=None, dest="seconds", help="end when nothing came for so long")
    given = parser.parse_args()
    heard: queue.Queue[bytes] = queue.Queue(10_000)

    def sink(sample: zenoh.Sample) -> None:
        if not heard.full():
            heard.put(sample.payload.to_bytes())

    seen = 0
    with session(given.addresses) as link:
        link.declare_subscriber(f"trigpoint/{quote(given.network, safe='-_.~')}/node/*/estimate", sink)
        while not given.count or seen < given.count:
            try:
                found = estimate(heard.get(timeout=given.seconds))
            except queue.Empty:
                break
            if found is not None:
                seen += 1
                print(json.dumps(found), flush=True)
    assert not given.count or seen == given.count, f"heard {seen} of {given.count} estimates"


if __name__ == "__main__":
    main()
