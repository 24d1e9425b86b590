"""The command line in this process and in a real one, and the files to feed it."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

from typer.testing import CliRunner, Result

from trigpoint.cli import app

MAIN = "import sys; sys.argv[0] = 'trigpoint'; from trigpoint.cli import main; main()"
NETWORK = "from,to,value,sigma\n,a,1.0,\na,b,0.5,0.01\nb,c,0.25,0.01\na,c,0.76,0.02\n"
FLOATING = "from,to,value,sigma\n,a,1.0,\na,b,0.5,0.01\nc,d,0.25,0.01\n"
AGENT = "[agent]\nA = [[0, 1], [0, 0]]\nC = [[1, 0]]\n"
SCENARIO = f'[network]\ngallery = {{ kind = "chain", n = 3 }}\n{AGENT}'
GKF = """<?xml version="1.0" encoding="UTF-8"?>
<gama-local><network><parameters sigma-apr="1.0"/><points-observations>
<point id="A" z="10.0" fix="z"/>
<point id="B" adj="z"/>
<height-differences>
<dh from="A" to="B" val="1.5" stdev="1.0"/>
</height-differences>
</points-observations></network></gama-local>
"""


def trigpoint(*arguments: object) -> Result:
    """Run a command here; an exception other than an exit is the test's failure."""
    result = CliRunner().invoke(app, [str(argument) for argument in arguments])
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        raise result.exception
    return result


def refuse_constant(word: str) -> None:
    raise AssertionError(f"{word} in JSON")


def json_of(result: Result) -> dict[str, Any]:
    """Standard output, which must be exactly one JSON object without NaN or infinity."""
    document = json.loads(result.stdout, parse_constant=refuse_constant)
    assert isinstance(document, dict)
    return document


def refused(result: Result, *words: str) -> str:
    """Exit code 2 with one error line and nothing else; returns the line."""
    assert result.exit_code == 2, result.output
    assert result.stdout == ""
    assert result.stderr.startswith("error: ")
    assert result.stderr.count("\n") == 1, result.stderr
    assert "Traceback" not in result.stderr
    for word in words:
        assert word in result.stderr, f"{word!r} is not in {result.stderr!r}"
    return result.stderr


def process(*arguments: object, cwd: Path, **environment: str) -> subprocess.CompletedProcess[str]:
    """Run the command as a user does."""
    return subprocess.run(
        [sys.executable, "-c", MAIN, *map(str, arguments)],
        capture_output=True,
        text=True,
        cwd=cwd,
        env={**os.environ, "OPENBLAS_NUM_THREADS": "1", **environment},
        check=False,
    )


def written(folder: Path, name: str, content: str | bytes) -> Path:
    path = folder / name
    path.write_bytes(content.encode("utf-8") if isinstance(content, str) else content)
    return path
