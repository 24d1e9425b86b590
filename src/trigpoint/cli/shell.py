"""What every command shares: exit codes, JSON on standard output, errors and progress on standard error."""

from __future__ import annotations

import functools
import io
import json
import math
import os
import sys
from collections.abc import Callable, Iterable, Iterator, Sized
from pathlib import Path
from typing import Annotated, Any, ParamSpec

import numpy as np
import typer
from rich.console import Console
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeElapsedColumn

from trigpoint.errors import ArgumentError, TrigpointError

HOLDS, FAILS, MISUSE, UNDECIDED = 0, 1, 2, 3
INTERRUPTED = 130  # as shells have it

_UNBOUNDED = 1_000_000  # columns: in a file or pipe no name is cut

P = ParamSpec("P")

Json = Annotated[bool, typer.Option("--json", help="Print one JSON object on standard output, and nothing else.")]
Out = Annotated[Path | None, typer.Option("--out", help="Where to write (a file or folder, see the command).")]
Input = Annotated[Path, typer.Argument(help="Edge list (.csv, .tsv), .gkf, .graphml, .json, or a scenario (.toml).")]


def guarded(command: Callable[P, int]) -> Callable[P, None]:
    """Turn the command's return value into the exit code, and errors into one line and exit code 2."""

    @functools.wraps(command)
    def run(*args: P.args, **kwargs: P.kwargs) -> None:
        _replace_unprintable()
        try:
            code = command(*args, **kwargs)
            sys.stdout.flush()  # here, where a reader that left is still ours to handle
        except TrigpointError as error:
            fail(str(error))
        except (ArithmeticError, np.linalg.LinAlgError) as error:
            fail(f"the numbers leave the range of floating point ({error}); check the units and the gain")
        except BrokenPipeError:  # the reader of our output left: nothing is wrong here
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            raise typer.Exit(HOLDS) from None
        except OSError as error:
            fail(f"{error.filename or 'the system'}: {error.strerror or error}")
        else:
            raise typer.Exit(code)

    # Help texts are wrapped to the terminal, not where the source was.
    run.__doc__ = "\n\n".join(" ".join(part.split()) for part in (command.__doc__ or "").split("\n\n"))
    return run


def ending(out: Path | None, *allowed: str) -> None:
    """Refuse an output name with another ending, before anything is computed."""
    special = out is not None and out.exists() and not out.is_file() and not out.is_dir()  # a device takes anything
    if out is not None and not special and out.suffix.lower() not in allowed:
        raise ArgumentError(f"{out}: expected a file name ending in {' or '.join(allowed)}")


def _replace_unprintable() -> None:
    """Let names that the terminal's encoding lacks appear as escapes, instead of ending the program."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")


def fail(text: str) -> None:
    """Print an error as one line on standard error and leave with exit code 2."""
    print("error: " + " ".join(line.strip() for line in text.splitlines()), file=sys.stderr)
    raise typer.Exit(MISUSE)


def notice(text: str) -> None:
    """Say something beside the result, on standard error."""
    print(text, file=sys.stderr)


def emit(document: dict[str, Any]) -> None:
    """Print one JSON object; NaN and infinity become null."""
    escaped = not (sys.stdout.encoding or "").lower().startswith("utf")
    print(json.dumps(plain(document), indent=2, allow_nan=False, ensure_ascii=escaped))


def plain(value: Any) -> Any:
    """The value in JSON's own types."""
    if isinstance(value, dict):
        return {str(key): plain(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [plain(entry) for entry in value]
    if isinstance(value, np.ndarray):
        return plain(value.tolist())
    if isinstance(value, np.generic):
        return plain(value.item())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def console() -> Console:
    """Standard output for people: styles on a terminal, plain text elsewhere; names are printed as they are."""
    width = None if sys.stdout.isatty() else _UNBOUNDED
    return _Screen(highlight=False, soft_wrap=True, markup=False, emoji=False, width=width)


class _Screen(Console):
    def on_broken_pipe(self) -> None:
        """Leave a reader that left to ``guarded``."""
        raise BrokenPipeError


def tracked(title: str) -> Callable[[Iterable[Any]], Iterable[Any]]:
    """A progress bar on standard error around a sequence; nothing when that is not a terminal.

    Nothing is taken from the sequence before it is due: a run computes while it is gone through. Its length is known
    from ``len``, or from the ``share`` of the whole that each item names.
    """

    def wrap(items: Iterable[Any]) -> Iterator[Any]:
        if not sys.stderr.isatty():
            yield from items
            return
        columns = (TextColumn("{task.description}"), BarColumn(), TaskProgressColumn(), TimeElapsedColumn())
        with Progress(*columns, console=Console(stderr=True), transient=True) as progress:
            count = len(items) if isinstance(items, Sized) else None
            task = progress.add_task(title, total=1.0)
            for number, item in enumerate(items, start=1):
                yield item
                share = number / count if count else getattr(item, "share", 0.0)
                progress.update(task, completed=share)

    return wrap
