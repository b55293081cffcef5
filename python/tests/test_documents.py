"""The code in README, in the guide and in the notebook runs."""

import re
import shutil
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).resolve().parents[2]


def blocks(document):
    """The page's Python, each block with the number of the line before it."""
    text = (ROOT / document).read_text()
    return [(text[: m.start()].count("\n") + 1, m[1]) for m in re.finditer(r"^```python\n(.*?)^```", text, re.S | re.M)]


def execute(document, folder, monkeypatch):
    """Runs all blocks one after the other, as one program, whose errors name lines of the page."""
    monkeypatch.chdir(folder)
    names = {}
    found = blocks(document)
    for line, block in found:
        exec(compile("\n" * line + block, document, "exec"), names)
    return found, names


def need(*packages):
    for package in packages:
        pytest.importorskip(package)


def test_ten_lines_of_readme_lead_to_every_package(tmp_path, monkeypatch):
    need("trimesh", "open3d", "pyvista")
    found, names = execute("README.md", tmp_path, monkeypatch)
    assert len(found) == 1 and len(found[0][1].splitlines()) == 10
    assert names["mesh"].is_sealed and (tmp_path / "sphere.ply").stat().st_size > 100_000
    for package in ("to_trimesh", "to_open3d", "to_pyvista"):
        assert f"mesh.{package}()" in found[0][1]


def test_the_guide_s_page_runs(tmp_path, monkeypatch, capsys):
    need("laspy", "trimesh", "open3d", "pyvista")
    found, names = execute("docs/python.md", tmp_path, monkeypatch)
    assert len(found) > 12 and (tmp_path / "again.glb").exists()
    # What the page says that is printed, but for the numbers.
    form = re.search(r"# (<asra_stream.Mesh.*>)", found[0][1])[1]
    assert re.sub("[0-9,]+", "", form) in re.sub("[0-9,]+", "", capsys.readouterr().out)


def test_the_package_s_own_page_runs(tmp_path, monkeypatch, sphere):
    need("trimesh", "laspy")
    import laspy

    monkeypatch.chdir(tmp_path)
    (tmp_path / "tiles").mkdir()
    np.save(tmp_path / "points.npy", sphere(20_000))
    las = laspy.create(point_format=3, file_version="1.2")
    las.header.scales = [1e-4] * 3
    las.x, las.y, las.z = sphere(20_000).T
    las.write(tmp_path / "tiles" / "one.laz")
    found, _ = execute("python/README.md", tmp_path, monkeypatch)
    assert len(found) == 1 and (tmp_path / "mesh.ply").exists() and (tmp_path / "city.glb").exists()


def test_the_notebook_leads_from_laz_to_pictures(tmp_path):
    need("nbclient", "ipykernel", "laspy", "pyvista")
    import nbformat
    from nbclient import NotebookClient

    path = ROOT / "examples" / "laz-to-picture.ipynb"
    book = nbformat.read(path, as_version=4)
    nbformat.validate(book)
    assert not any(cell.get("outputs") for cell in book.cells), "outputs are not kept: they tell of machines"
    (tmp_path / "examples").mkdir()
    (tmp_path / "tests").symlink_to(ROOT / "tests")
    shutil.copy(path, tmp_path / "examples")
    NotebookClient(book, timeout=300, resources={"metadata": {"path": tmp_path / "examples"}}).execute()
    data = [output["data"] for cell in book.cells for output in cell.get("outputs", []) if "data" in output]
    pictures = [one for one in data if "image/png" in one]
    # Two meshes that show themselves, and a picture that was asked for.
    assert len(pictures) == 3
    shown = [one["text/plain"] for one in pictures if one["text/plain"].startswith("<asra_stream.Mesh: ")]
    assert len(shown) == 2
    assert (tmp_path / "examples" / "stadium.laz").stat().st_size > 500_000
