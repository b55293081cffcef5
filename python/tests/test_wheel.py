"""What is in the package: its allocator, its types, its command."""

import subprocess
import sys
from importlib import metadata
from pathlib import Path

import asra_stream
from asra_stream import _core


def test_no_allocator_comes_along():
    library = Path(_core.__file__).read_bytes()
    # The names that mimalloc's messages and settings begin with; the command as Cargo builds it has them.
    assert b"mimalloc" not in library and b"MIMALLOC" not in library
    assert len(library) > 1_000_000


def test_the_package_is_one_abi3_module_with_types_and_a_command():
    folder = Path(asra_stream.__file__).parent
    assert _core.__file__.endswith((".abi3.so", ".pyd"))
    assert (folder / "py.typed").exists() and (folder / "_core.pyi").exists()
    distribution = metadata.distribution("asra-stream")
    assert [point.name for point in distribution.entry_points if point.group == "console_scripts"] == ["asra-stream"]
    assert distribution.version == asra_stream.__version__
    assert [line for line in distribution.requires if "extra ==" not in line] == ["numpy>=1.23"]


def test_every_name_has_a_docstring():
    for name in asra_stream.__all__:
        thing = getattr(asra_stream, name)
        assert name == "__version__" or thing.__doc__, name
    for name, thing in vars(asra_stream.Mesh).items():
        if not name.startswith("_"):
            assert thing.__doc__, f"Mesh.{name}"


def test_the_command_s_exit_codes_come_through(tmp_path):
    command = [sys.executable, "-m", "asra_stream"]
    done = subprocess.run([*command, "--version"], capture_output=True, text=True)
    assert done.returncode == 0 and asra_stream.__version__ in done.stdout
    missing = subprocess.run([*command, tmp_path / "none.ply"], capture_output=True, text=True)
    assert missing.returncode == 66 and "none.ply" in missing.stderr
