#!/usr/bin/env python3
"""Builds the Python package and tests it in an environment of its own.

    tools/python.py            the wheel and the sources' archive, in python/dist; all tests, with the packages that it works with; the stubs; the doctests
    tools/python.py --smoke    a wheel without optimisation, and the tests but for the longest: what CI does
    tools/python.py --runs 1000      the test of memory with so many runs
    tools/python.py --measure  after that, figures: overhead, Ctrl-C, pieces, many runs, threads (tools/python_figures.py)
    tools/python.py --target aarch64-unknown-linux-gnu      the wheel of another processor, looked at, but not run

The wheel is for any Python from 3.10 on (abi3), and for Linux with glibc 2.17 or newer (manylinux2014). It needs Rust, Python with venv, and the package
registries; the C compiler is that of the package ziglang. All packages have wheels for Python 3.10 to 3.13 at least; with another, tests of one that has none are left out.
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
COMPILER = ["ziglang"]
AUDIT = ["auditwheel", "abi3audit"]
SMOKE = ["numpy", "pytest"]
FULL = [*SMOKE, "distributed", "mypy", "types-tqdm", "tqdm", "laspy[lazrs]", "pandas", "trimesh", "pyvista", "nbclient", "nbformat", "ipykernel"]
# Not for every version of Python.
WHERE_THERE_IS_ONE = ["open3d"]
MANYLINUX = "manylinux2014"
# What takes long without optimisation.
LONG = "not ctrl_c and not counts_on and not nothing_behind"


def call(*command, **options):
    print("+", *command, flush=True)
    subprocess.run([str(word) for word in command], check=True, **options)


def audit(folder, wheel):
    """Whether the wheel runs on the systems, and with the versions of Python, that its name says."""
    python = environment(folder, AUDIT)
    found = subprocess.run([python, "-m", "auditwheel", "show", wheel], check=True, capture_output=True, text=True).stdout
    print(found)
    said = " ".join(found.split())
    if "manylinux_2_17_" not in said.split("is consistent with the following platform tag:")[1].split(".")[0]:
        sys.exit(f"{wheel.name}: expected a wheel for {MANYLINUX}")
    call(python, "-m", "abi3audit", "--strict", "--summary", wheel)


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
    parser.add_argument("--measure", action="store_true", help="also the figures")
    parser.add_argument("--target", help="a wheel of another processor or system, which is not tested")
    arguments = parser.parse_args()
    target = Path(os.environ.get("CARGO_TARGET_DIR", ROOT / "target")) / "python"
    dist = target / "smoke" if arguments.smoke else PYTHON / "dist"
    if not arguments.target:
        shutil.rmtree(dist, ignore_errors=True)
    build = environment(target / "build", BUILD if arguments.smoke else [*BUILD, *COMPILER])
    # A smoke test shares what the program's tests have compiled. Zig is found by its name, too.
    built = target.parent if arguments.smoke else target
    cargo = os.environ | {"CARGO_TARGET_DIR": str(built), "PATH": f"{build.parent}{os.pathsep}{os.environ['PATH']}"}
    how = ["--profile", "dev"] if arguments.smoke else ["--profile", "release", "--zig", "--compatibility", MANYLINUX]
    if arguments.target:
        how += ["--target", arguments.target]
    before = set(dist.glob("*.whl"))
    call(build, "-m", "maturin", "build", "--locked", *how, "-o", dist, cwd=PYTHON, env=cargo)
    wheels = sorted(set(dist.glob("*.whl")) - before)
    if not arguments.smoke:
        [audit(target / "audit", wheel) for wheel in wheels]
    if arguments.target:
        return
    if not arguments.smoke:
        call(build, "-m", "maturin", "sdist", "-o", dist, cwd=PYTHON, env=cargo)
    python = environment(target / "test", [*(SMOKE if arguments.smoke else FULL), *wheels])
    if not arguments.smoke:
        for package in WHERE_THERE_IS_ONE:
            if subprocess.run([python, "-m", "pip", "install", "-q", package]).returncode:
                print(f"{package}: no wheel for this Python; the tests with it are left out")
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
    if arguments.measure:
        call("cargo", "build", "--release", "--locked", cwd=ROOT)
        call(sys.executable, ROOT / "tools/python_figures.py", python, target.parent / "release/asra-stream", "--work", target)
    print(f"the Python package is in order; {', '.join(path.name for path in sorted(dist.iterdir()))}")


if __name__ == "__main__":
    main()
