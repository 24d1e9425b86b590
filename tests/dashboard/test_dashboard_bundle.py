"""The built page is the one of the sources, nothing in it was touched afterwards, and the wheel carries it alone."""

import hashlib
import json
import subprocess
import sys
from pathlib import Path

import trigpoint.dashboard

FOLDER = Path(trigpoint.dashboard.__file__).parent
WEB, STATIC = FOLDER / "web", FOLDER / "static"
TOP = ("build.mjs", "index.html", "package-lock.json", "package.json", "tsconfig.json")


def sha256(data):
    return hashlib.sha256(data).hexdigest()


def digest_of_sources():
    """As ``web/build.mjs`` computes it."""
    names = [*TOP, *(path.relative_to(WEB).as_posix() for path in (WEB / "src").rglob("*") if path.is_file())]
    lines = (f"{name}\0{sha256((WEB / name).read_bytes())}\n" for name in sorted(names))
    return sha256("".join(lines).encode())


def test_the_bundle_was_built_from_these_sources():
    built = json.loads((STATIC / "built.json").read_text("utf-8"))
    remedy = "the page's sources changed: run `make page` and commit dashboard/static"
    assert built["sources"] == digest_of_sources(), remedy
    script = (STATIC / "app.js").read_text("utf-8")
    assert built["sources"] in script.splitlines()[0]
    assert script.count(built["sources"]) == 2  # the banner, and what the page itself can tell


def test_the_bundle_is_as_it_was_built():
    built = json.loads((STATIC / "built.json").read_text("utf-8"))
    found = {path.name: sha256(path.read_bytes()) for path in STATIC.iterdir() if path.name != "built.json"}
    assert found == built["files"]
    assert {"app.js", "index.html", "page.css", "icon.svg", "licences.txt"} <= set(found)


def test_the_bundle_stays_small_and_names_its_parts():
    assert (STATIC / "app.js").stat().st_size < 320_000
    licences = (STATIC / "licences.txt").read_text("utf-8")
    lock = json.loads((WEB / "package-lock.json").read_text("utf-8"))
    carried = [folder for folder, entry in lock["packages"].items() if folder and not entry.get("dev")]
    assert len(carried) >= 5
    for folder in carried:
        assert f"{folder.removeprefix('node_modules/')} {lock['packages'][folder]['version']}" in licences
    assert "MIT" in licences


def test_the_wheel_holds_the_page_and_not_its_sources():
    code = (
        "from hatchling.builders.wheel import WheelBuilder\n"
        "for file in WheelBuilder('.').recurse_included_files(): print(file.distribution_path)"
    )
    root = FOLDER.parents[2]
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=root, check=False)
    assert done.returncode == 0, done.stderr
    inside = set(done.stdout.split())
    assert {f"trigpoint/dashboard/static/{path.name}" for path in STATIC.iterdir()} <= inside
    assert not [name for name in inside if "/web/" in name]
