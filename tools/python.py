#!/usr/bin/env python3
"""Builds the Python package and tests it in an environment of its own.

    tools/python.py            the wheel and the sources' archive, in python/dist; all tests, the stubs, the doctests; with laspy and trimesh
    tools/python.py --smoke    a wheel without optimisation, and the tests but for the longest: what CI does
    tools/python.py --runs 1000      the test of memory with so many runs

The wheel is for any Python from 3.10 on (abi3). It needs Rust, Python with venv, and the package registries.
"""

import argparse
import os
import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
PYTHON = ROOT / "python"
BUILD = ["maturin>=1.9,<2"]
SMOKE = ["numpy", "pytest"]
FULL = [*SMOKE, "mypy", "laspy[lazrs]", "trimesh", "types-tqdm"]
# What takes long without optimisation.
LONG = "not ctrl_c and not counts_on and not nothing_behind"


def call(*command, **options):
    print("+", *command, flush=True)
    subprocess.run([str(word) for word in command], check=True, **options)


def environment(folder, packages):
    """A fresh environment with these packages; its Python."""
    call(sys.executable, "-m", "venv", "--clear", folder)
    python = folder / "bin/python"
    call(python, "-m", "pip", "install", "-q", "--disable-pip-version-check", *packages)
    return python


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--smoke", action="store_true", help="a wheel without optimisation, few tests")
    parser.add_argument("--runs", type=int, default=100, help="runs of the test of memory")
    arguments = parser.parse_args()
    target = Path(os.environ.get("CARGO_TARGET_DIR", ROOT / "target")) / "python"
    dist = target / "smoke" if arguments.smoke else PYTHON / "dist"
    shutil.rmtree(dist, ignore_errors=True)
    build = environment(target / "build", BUILD)
    cargo = os.environ | {"CARGO_TARGET_DIR": str(target)}
    profile = "dev" if arguments.smoke else "release"
    call(build, "-m", "maturin", "build", "--locked", "--profile", profile, "-o", dist, cwd=PYTHON, env=cargo)
    if not arguments.smoke:
        call(build, "-m", "maturin", "sdist", "-o", dist, cwd=PYTHON, env=cargo)
    python = environment(target / "test", [*(SMOKE if arguments.smoke else FULL), *dist.glob("*.whl")])
    tests = [python, "-m", "pytest", "-q", PYTHON / "tests"]
    # From another folder, so that it is the wheel that is tested.
    if arguments.smoke:
        call(*tests, "-k", LONG, cwd=target)
    else:
        call(*tests, cwd=target, env=os.environ | {"ASRA_STREAM_RUNS": str(arguments.runs)})
        config = PYTHON / "pyproject.toml"
        call(python, "-m", "mypy.stubtest", "asra_stream", "--mypy-config-file", config, cwd=target)
    told = "import doctest, sys, asra_stream; sys.exit(doctest.testmod(asra_stream).failed)"
    call(python, "-c", told, cwd=target)
    command = target / "test/bin/asra-stream"
    call(command, "--version")
    print(f"the Python package is in order; {', '.join(path.name for path in sorted(dist.iterdir()))}")


if __name__ == "__main__":
    main()
