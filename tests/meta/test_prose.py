"""Nothing in the house points at one machine."""

from __future__ import annotations

import re

from house import ROOT, listing

FOLDERS = ("src", "tests", "docs", "examples", "benchmarks", ".ci")
SUFFIXES = {".py", ".md", ".toml", ".bib", ".cff", ".csv", ".tsv", ".html", ".css", ".js", ".json", ".gkf", ".g2o", ""}
MACHINE = re.compile(r"(?<![\w.\-/])/(?:home|root|tmp|work)\b(?:/|$|[\s\"'`])|https?://local" + "host")


def own_text_files() -> list[tuple[str, str]]:
    files = [path for path in ROOT.iterdir() if path.is_file()]
    files += [path for folder in FOLDERS for path in (ROOT / folder).rglob("*") if path.is_file()]
    generated = {"_build", "__pycache__", "node_modules"}
    chosen = [p for p in files if p.suffix in SUFFIXES and not generated & set(p.relative_to(ROOT).parts)]
    return [(str(p.relative_to(ROOT)), p.read_text(encoding="utf-8")) for p in sorted(chosen)]


def test_no_path_or_host_of_one_machine() -> None:
    failures = [
        f"{name}:{number}: {line.strip()[:100]}"
        for name, text in own_text_files()
        for number, line in enumerate(text.splitlines(), start=1)
        if MACHINE.search(line)
    ]
    assert not failures, listing(failures)
