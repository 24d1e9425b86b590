"""The user's picture: read in three formats, averaged to the size that is simulated, refused with a reason."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.papers.runs import at
from trigpoint.arrays import FloatArray
from trigpoint.errors import ArgumentError, FileFormatError
from trigpoint.papers import reproduce
from trigpoint.papers.pictures import night_scene, read_picture


def pgm(levels: FloatArray, kind: str = "P5", top: int = 255) -> bytes:
    rows, columns = levels.shape
    head = f"{kind}\n# drawn by a test\n{columns} {rows}\n{top}\n".encode()
    whole = np.round(levels * (top / 255.0))
    if kind == "P2":
        return head + "\n".join(" ".join(f"{value:.0f}" for value in row) for row in whole).encode()
    return head + whole.astype(np.uint8 if top < 256 else ">u2").tobytes()


def written(folder: Path, kind: str, levels: FloatArray) -> Path:
    path = folder / f"picture.{kind}"
    if kind == "pgm":
        path.write_bytes(pgm(levels))
    elif kind == "npy":
        np.save(path, levels)
    else:
        from matplotlib.image import imsave

        imsave(path, levels, cmap="gray", vmin=0.0, vmax=255.0)
    return path


def test_the_own_picture_is_grey_and_repeats() -> None:
    picture = night_scene()
    assert picture.shape == (70, 128)
    assert picture.min() >= 0.0
    assert picture.max() <= 255.0
    assert 60.0 < picture.mean() < 110.0
    np.testing.assert_array_equal(picture, night_scene())
    assert night_scene(20, 30, seed=1).shape == (20, 30)


@pytest.mark.parametrize(("kind", "exact"), [("pgm", 0.51), ("npy", 1e-9), ("png", 2.0)])
def test_a_picture_of_the_right_size_comes_back(tmp_path: Path, kind: str, exact: float) -> None:
    picture = night_scene()
    found = read_picture(written(tmp_path, kind, picture))
    assert np.abs(found - picture).max() < exact


@pytest.mark.parametrize(("kind", "top"), [("P2", 255), ("P5", 255), ("P5", 1000), ("P2", 7)])
def test_pgm_of_both_kinds_and_any_depth(tmp_path: Path, kind: str, top: int) -> None:
    picture = night_scene(6, 9)
    path = tmp_path / "a.pgm"
    path.write_bytes(pgm(picture, kind, top))
    assert np.abs(read_picture(path, (6, 9)) - picture).max() <= 128.0 / top + 1e-9


def test_a_larger_picture_is_averaged(tmp_path: Path) -> None:
    picture = np.random.default_rng(0).uniform(0.0, 255.0, (60, 84))
    path = written(tmp_path, "npy", picture)
    blocks = picture.reshape(6, 10, 7, 12).mean(axis=(1, 3))
    np.testing.assert_allclose(read_picture(path, (6, 7)), blocks, atol=1e-9)
    uneven = read_picture(path, (7, 11))
    assert uneven.shape == (7, 11)
    assert uneven.mean() == pytest.approx(picture.mean(), rel=1e-9)


def test_a_smaller_picture_is_spread(tmp_path: Path) -> None:
    path = written(tmp_path, "npy", np.array([[0.0, 200.0]]))
    np.testing.assert_allclose(read_picture(path, (2, 4)), [[0.0, 0.0, 200.0, 200.0]] * 2, atol=1e-9)


def test_colours_become_their_luminance(tmp_path: Path) -> None:
    from matplotlib.image import imsave

    path = tmp_path / "c.png"
    imsave(path, np.array([[[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], [[0.0, 0.0, 1.0], [1.0, 1.0, 1.0]]]))
    found = read_picture(path, (2, 2))
    np.testing.assert_allclose(found, 255.0 * np.array([[0.299, 0.587], [0.114, 1.0]]), atol=0.01)


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("a.jpg", b"", "ending in .pgm, .png or .npy"),
        ("a.pgm", b"P6\n1 1\n255\nabc", "expected P2 or P5"),
        ("a.pgm", b"", "expected P2 or P5"),
        ("a.pgm", b"P5\n0 3\n255\n", "must be positive"),
        ("a.pgm", b"P5\n2 2\n255\nabc", "ends after 3 of 4"),
        ("a.pgm", b"P2\n2 1\n255\n1 x", "whole numbers"),
        ("a.png", b"no picture", "is no PNG picture"),
        ("a.npy", b"no table", "is no table of numbers"),
    ],
)
def test_what_is_no_picture_is_refused(tmp_path: Path, name: str, content: bytes, words: str) -> None:
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(FileFormatError, match=words) as caught:
        read_picture(path)
    assert str(caught.value).startswith(str(path))


@pytest.mark.parametrize(
    ("table", "words"),
    [
        (np.zeros(3), "must hold a table"),
        (np.array([["a"]]), "must hold a table"),
        (np.array([[300.0]]), "outside 0..255"),
        (np.array([[np.nan]]), "outside 0..255"),
    ],
)
def test_a_table_that_is_no_picture_is_refused(tmp_path: Path, table: np.ndarray, words: str) -> None:
    path = tmp_path / "t.npy"
    np.save(path, table)
    with pytest.raises(FileFormatError, match=words):
        read_picture(path)


def test_an_absent_picture_and_an_empty_size_are_refused(tmp_path: Path) -> None:
    with pytest.raises(FileFormatError, match="there is no such file"):
        read_picture(tmp_path / "none.pgm")
    with pytest.raises(ArgumentError, match="at least one row"):
        read_picture(written(tmp_path, "npy", np.ones((2, 2))), (0, 3))


def test_png_says_which_extra_it_needs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from trigpoint.errors import MissingExtraError

    path = written(tmp_path, "png", night_scene(4, 5))
    monkeypatch.setitem(__import__("sys").modules, "matplotlib.image", None)
    with pytest.raises(MissingExtraError, match="report"):
        read_picture(path)


def test_the_experiment_takes_the_users_picture(tmp_path: Path) -> None:
    dark = written(tmp_path, "npy", np.full((30, 40), 20.0))
    result = reproduce("r23-image", image=dark, rows=9, columns=16)
    np.testing.assert_allclose(result.fields[0].values, 20.0, atol=1e-9)
    assert at(result, "agents") == 144
    assert not result.agrees  # another size than the paper's


def test_a_picture_without_slow_mode_has_no_predicted_time(tmp_path: Path) -> None:
    level = np.random.default_rng(0).uniform(0.0, 255.0, (70, 128))  # the seed of the first estimates: no error at all
    noise = np.random.default_rng(1).uniform(-60.0, 60.0, level.shape)
    image = written(tmp_path, "npy", np.clip(level + noise - noise.mean(), 0.0, 255.0))
    result = reproduce("r23-image", image=image)
    entry = next(one for one in result.cells if one.at == "time to 1 %, measured, s")
    assert entry.verdict == "not specified"
    assert 0.0 < entry.ours < 15.0
    assert result.agrees
