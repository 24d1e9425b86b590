"""The rules of every test run: drawn examples that can be repeated, the reference data, and no silent skip."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

DATA_ABSENT = "the reference data folder is absent (TRIGPOINT_SHARED_DATA, or ../shared/data beside the checkout)"
IN_CI = bool(os.environ.get("CI"))
ALLOWED_SKIPS = () if IN_CI else (DATA_ABSENT,)

# No example fails for the time that it takes: neither by a deadline nor while examples are drawn.
settings.register_profile(
    "trigpoint", deadline=None, suppress_health_check=[HealthCheck.too_slow], print_blob=True, derandomize=IN_CI
)
settings.load_profile("trigpoint")


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """Folder of the published reference data; without it the test is skipped, or fails where CI is set."""
    given = os.environ.get("TRIGPOINT_SHARED_DATA")
    folder = Path(given) if given else Path(__file__).resolve().parents[2] / "shared" / "data"
    if folder.is_dir():
        return folder
    if IN_CI:
        pytest.fail(f"{DATA_ABSENT}: {folder}")
    pytest.skip(DATA_ABSENT)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    for item in items:
        if "shared_data" in getattr(item, "fixturenames", ()):
            item.add_marker(pytest.mark.shared_data)


class SkipGuard:
    """Counts skips and fails the run when one has a reason that is not allowed."""

    def __init__(self) -> None:
        self.unexpected: list[str] = []

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        self._note(report)

    def pytest_collectreport(self, report: pytest.CollectReport) -> None:
        self._note(report)

    def _note(self, report: pytest.TestReport | pytest.CollectReport) -> None:
        if not report.skipped or hasattr(report, "wasxfail"):
            return
        reason = report.longrepr[2] if isinstance(report.longrepr, tuple) else str(report.longrepr)
        if reason.removeprefix("Skipped: ") not in ALLOWED_SKIPS:
            self.unexpected.append(f"{report.nodeid}: {reason}")

    def pytest_sessionfinish(self, session: pytest.Session) -> None:
        if self.unexpected and session.exitstatus in (pytest.ExitCode.OK, pytest.ExitCode.NO_TESTS_COLLECTED):
            session.exitstatus = pytest.ExitCode.TESTS_FAILED

    @pytest.hookimpl(wrapper=True)
    def pytest_terminal_summary(self, terminalreporter: pytest.TerminalReporter) -> Iterator[None]:
        yield
        if self.unexpected:
            terminalreporter.section("tests skipped for a reason that is not allowed", red=True, bold=True)
            for line in self.unexpected:
                terminalreporter.line(line)


def pytest_configure(config: pytest.Config) -> None:
    if not hasattr(config, "workerinput"):
        config.pluginmanager.register(SkipGuard(), "trigpoint-skip-guard")
