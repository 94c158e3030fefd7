"""Makes .venv, the environment of `make sweep` and `make test`: ROS wheels, bow_msgs, bow (editable), compiled kernels.

`make setup` runs this with the system's Python of any version, before anything is installed: standard library only. At
the very end .venv/.bow-setup.json records what was installed, with a hash of its inputs; a part is installed again when
its hash changes.
"""

import argparse
import contextlib
import fcntl
import glob
import hashlib
import json
import os
import platform
import shutil
import subprocess
import sys
import sysconfig
import time

ROOT = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
VENV = os.path.join(ROOT, ".venv")
PYTHON = os.path.join(VENV, "bin", "python")
RECORD = os.path.join(VENV, ".bow-setup.json")
STARTED = os.path.join(VENV, ".bow-setup.started")  # marks an environment of ours that is not finished

# Variables of ROS, Python and Numba in the caller's shell. With them the Python of .venv would load other libraries, or
# store compiled code elsewhere than beside the sources, where all users of this installation find it.
LEAKS = (
    "_ROS_WHEELS_BOOTSTRAP_COMPLETE AMENT_PREFIX_PATH CMAKE_PREFIX_PATH COLCON_PREFIX_PATH LD_LIBRARY_PATH PYTHONHOME "
    "PYTHONPATH ROS_DISTRO ROS_VERSION ROS_PYTHON_VERSION VIRTUAL_ENV PIP_PREFIX PIP_TARGET PIP_USER "
    "PYTHONWARNINGS NUMBA_CACHE_DIR NUMBA_CACHE_LOCATOR_CLASSES NUMBA_DISABLE_JIT"
).split()

# The system's Python, for callers whose python3 is one that they have compiled themselves.
SYSTEM_PYTHON = "/usr/bin/python3"

# The inputs of each part. Python sources are not among them: the installation is editable.
INPUTS = {
    "bow_msgs": ["msg_defs"],
    "bow": ["setup.py", "setup.cfg", "pyproject.toml", "package.xml", "requirements.txt", "constraints.txt"],
    "test tools": ["requirements-dev.txt", "constraints.txt"],
}


def say(text):
    print("setup: " + text, flush=True)


def stop(text):
    sys.exit("setup: " + text)


# --- prerequisites ----------------------------------------------------------------------------------------------------


def missing_prerequisites(uv):
    """Return what this machine lacks, as (what, Debian package)."""
    version = "python{}.{}".format(*sys.version_info)
    # Packages of Debian's default Python are named python3-*, those of another version python3.X-*.
    package = "python3" if sys.executable.startswith("/usr/bin/") else version
    missing = []
    if not any(shutil.which(name) for name in [os.environ.get("CXX", "g++"), "g++", "clang++"]):
        missing.append(("a C++ compiler (the interfaces are compiled)", "g++"))
    if not os.path.isfile(os.path.join(sysconfig.get_paths()["include"], "Python.h")):
        missing.append(("Python.h, the headers of " + sys.executable, package + "-dev"))
    if not uv:
        try:
            import ensurepip  # noqa: F401 - only to see whether it exists
            import venv  # noqa: F401
        except ImportError:
            missing.append(("the modules venv and ensurepip of " + sys.executable, package + "-venv"))
    return missing


def base_python():
    """Return the Python on which the virtual environment is based, where this one runs in one."""
    return os.path.realpath(getattr(sys, "_base_executable", None) or sys.executable)


def optimised():
    """Return whether this Python was compiled with optimisations: a sweep starts 20 % faster. pyenv omits them."""
    known = sysconfig.get_config_var("CONFIG_ARGS") or "--enable-optimizations"
    return "--enable-optimizations" in known or base_python().startswith("/usr/bin/")  # a distribution's Python is


def known_version():
    """Return whether there are ROS wheels for this Python."""
    return (3, 10) <= sys.version_info[:2] <= (3, 14)


def faster_python():
    """Return the system's Python, where .venv can use it and this one is not optimised; None otherwise."""
    if optimised() or not os.path.exists(SYSTEM_PYTHON):
        return None
    answer = subprocess.run(
        [SYSTEM_PYTHON, os.path.abspath(__file__), "--is-good"], env=clean_environment(), check=False
    )
    return None if answer.returncode else SYSTEM_PYTHON


def check_machine(uv):
    if sys.platform != "linux" or platform.machine() not in ("x86_64", "AMD64"):
        stop(
            "PyPI has the ROS wheels for Linux on x86-64 only, and this is {} on {}. With a ROS 2 Jazzy installation "
            "use the workspace route of README.md (colcon build).".format(sys.platform, platform.machine())
        )
    if not known_version():
        others = [name for name in ("python3." + str(minor) for minor in range(14, 9, -1)) if shutil.which(name)]
        advice = (
            "Type: make setup PYTHON=" + others[0] if others else "Install one, and type: make setup PYTHON=python3.X"
        )
        stop(
            "{} is Python {}, and the ROS wheels are for 3.10 to 3.14. {}".format(
                sys.executable, platform.python_version(), advice
            )
        )
    missing = missing_prerequisites(uv)
    if missing:
        for what, package in missing:
            say("missing: {} - Debian package {}".format(what, package))
        stop("install them and start again:  sudo apt-get install " + " ".join(package for _, package in missing))


# --- what is installed and what is due --------------------------------------------------------------------------------


def fingerprint(paths):
    """Return the hash of the names and bytes of files, and of all files in folders."""
    digest = hashlib.sha256()
    for path in paths:
        full = os.path.join(ROOT, path)
        files = [full]
        if os.path.isdir(full):
            files = [os.path.join(base, name) for base, _, names in os.walk(full) for name in names]
            files = [name for name in files if "__pycache__" not in name]
        for name in sorted(files):
            with open(name, "rb") as file:
                content = file.read()
            digest.update("{} {}\n".format(os.path.relpath(name, ROOT), len(content)).encode())
            digest.update(content)
    return digest.hexdigest()


def kernel_stamp():
    """Return the hash of what Numba's cache depends on: times and sizes of sources, and the processor's features."""
    files = []
    for room in ("bow_sim", "bow_classifier"):
        found = [os.path.join(base, name) for base, _, names in os.walk(os.path.join(ROOT, room)) for name in names]
        files += sorted(name for name in found if name.endswith(".py"))
    with open("/proc/cpuinfo") as file:
        processor = sorted({line for line in file if line.startswith(("flags", "model name"))})
    times = [[os.path.relpath(name, ROOT), os.stat(name).st_mtime_ns, os.stat(name).st_size] for name in files]
    return hashlib.sha256(json.dumps([times, processor]).encode()).hexdigest()


def read_record():
    try:
        with open(RECORD) as file:
            return json.load(file)
    except (OSError, ValueError):
        return {}


def write_record(record):
    part = RECORD + ".part"
    with open(part, "w") as file:
        json.dump(record, file, indent=1, sort_keys=True)
        file.flush()
        os.fsync(file.fileno())
    os.replace(part, RECORD)


# --- installation -----------------------------------------------------------------------------------------------------


def clean_environment():
    return {name: value for name, value in os.environ.items() if name not in LEAKS}


def run(command, what):
    run_together([(command, what)])


def run_together(jobs):
    """Run commands at the same time, each given as (command, what it does); if one fails, end the others and stop."""
    started = said = time.monotonic()
    running = []
    try:
        for command, what in jobs:
            running.append((subprocess.Popen(command, cwd=ROOT, env=clean_environment()), command, what))
        while running:
            for job in list(running):
                process, command, what = job
                try:
                    failed = process.wait(timeout=1)
                except subprocess.TimeoutExpired:
                    continue
                running.remove(job)
                if failed:
                    stop(failure(command, what))
                say("{}: done in {:.0f} s".format(what, time.monotonic() - started))
            if running and time.monotonic() - said >= 30:
                said = time.monotonic()
                names = " and ".join(what for _, _, what in running)
                say("{}: still at it after {:.0f} s".format(names, said - started))
    except BaseException:
        for process, _, _ in running:
            process.terminate()
        for process, _, _ in running:
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(timeout=10)
        raise


def failure(command, what):
    hint = " (make ... UV=no takes pip instead of uv)" if "pip" in command and PYTHON not in command[:1] else ""
    return "{} failed; the lines above say why. Mend that, and type the same command again{}.".format(what, hint)


def create(uv, home):
    """Create an empty environment; `home` is the entry of the record on its Python and its folder."""
    if os.path.lexists(VENV):
        if not (os.path.exists(RECORD) or os.path.exists(STARTED)):
            stop(VENV + " exists, but make setup did not make it. Move it away (or: make clean).")
        shutil.rmtree(VENV)
    os.mkdir(VENV)
    open(STARTED, "w").close()
    if uv:
        command = [uv, "venv", "--quiet", "--allow-existing", "--python", home["python"], VENV]
    else:
        command = [home["python"], "-m", "venv", VENV]
    run(command, "making .venv with Python " + home["version"])


def install(uv, arguments, what):
    if uv:
        command = [uv, "pip", "install", "--quiet", "--compile-bytecode", "--python", PYTHON]
    else:
        command = [PYTHON, "-m", "pip", "--disable-pip-version-check", "install", "-qq", "--no-warn-script-location"]
    run([*command, "--constraint", "constraints.txt", *arguments], what)


def requirements():
    """Return the lines of requirements.txt that are on PyPI; ./msg_defs and . are installed separately."""
    with open(os.path.join(ROOT, "requirements.txt")) as file:
        lines = [line.split("#")[0].strip() for line in file]
    return [line for line in lines if line and not line.startswith(".")]


def link_share():
    """Link the data files of `bow`, which editable installations omit, to the sources, so that edits take effect."""
    links = {
        "share/ament_index/resource_index/packages/bow": "resource/bow",
        "share/bow/package.xml": "package.xml",
        "share/bow/launch": "launch",
        "share/bow/config": "config",
    }
    for name in os.listdir(os.path.join(ROOT, "resource", "lib")):
        if name != "node":
            links["lib/bow/" + name] = "resource/lib/node"
    for link, source in links.items():
        place = os.path.join(VENV, link)
        target = os.path.relpath(os.path.join(ROOT, source), os.path.dirname(place))
        if os.path.islink(place) and os.readlink(place) == target:
            continue
        os.makedirs(os.path.dirname(place), exist_ok=True)
        with contextlib.suppress(FileNotFoundError):
            os.unlink(place)
        os.symlink(target, place)


def sync(uv, tests):
    home = {"python": base_python(), "version": platform.python_version(), "place": ROOT}
    wanted = {part: fingerprint(paths) for part, paths in INPUTS.items() if tests or part != "test tools"}
    record = read_record()
    if record.get("home") != home or not os.path.exists(PYTHON):
        if record:
            say("Python or the place of this folder changed: making .venv anew")
        elif os.path.exists(STARTED):
            say("the last set-up did not come to its end: making .venv anew")
        create(uv, home)
        record = {"home": home, "parts": {}}
    parts = record["parts"]
    if "test tools" in parts and "test tools" not in wanted:
        wanted["test tools"] = fingerprint(INPUTS["test tools"])  # once installed, they are kept up to date
    due = [part for part in wanted if parts.get(part) != wanted[part]]
    reused = [part for part in wanted if part not in due]
    if reused:
        say("reusing .venv: " + ", ".join(reused))
    if due:
        say("installing with {}: {}".format("uv" if uv else "pip", ", ".join(due)))
        open(STARTED, "w").close()
        with contextlib.suppress(FileNotFoundError):
            os.unlink(RECORD)  # if this is interrupted there is no record, and the next run starts anew
        arguments = []
        if "bow_msgs" in due:
            arguments += ["./msg_defs"] + (["--reinstall-package", "bow_msgs"] if uv else [])
        if "bow" in due or "test tools" in due:
            arguments += [*requirements(), "--editable", ".[explore,data,optimise]"]
        if "test tools" in due:
            arguments += ["--requirement", "requirements-dev.txt"]
        install(uv, arguments, "installing " + ", ".join(due))
        parts.update(wanted)
        record.pop("kernels", None)  # new libraries may need a new compilation
    link_share()
    write_record(record)
    with contextlib.suppress(FileNotFoundError):
        os.unlink(STARTED)
    return record


def precompile(record):
    """Compile kernels and classifier once, so that not every simulator does; both at a time, each takes one core."""
    stamp = kernel_stamp()
    if record.get("kernels") == stamp:
        say("reusing the compiled kernels")
        return
    run_together(
        [
            ([PYTHON, "-m", "bow_sim.kernel.precompile"], "compiling the kernels"),
            ([PYTHON, "-m", "bow_classifier.precompile"], "compiling the classifier"),
        ]
    )
    # Seven processes start in every sweep. None should have to compile its sources again, even where
    # PYTHONDONTWRITEBYTECODE is set.
    libraries = glob.glob(os.path.join(VENV, "lib", "python3*", "site-packages"))
    sources = ["bow", "bow_sim", "bow_classifier", "bow_sweep", *libraries]
    run([PYTHON, "-m", "compileall", "-qq", "-j", "0", *sources], "compiling Python's modules")
    record["kernels"] = stamp
    write_record(record)


def main():
    parser = argparse.ArgumentParser(description="Make or refresh .venv.")
    parser.add_argument("--tests", action="store_true", help="also install what `make test` needs")
    parser.add_argument("--this-python", action="store_true", help="use the Python that runs this, not that of .venv")
    parser.add_argument(
        "--is-good", action="store_true", help="exit with 0 if .venv can use this Python, and do nothing else"
    )
    options = parser.parse_args()
    uv = None if os.environ.get("UV") == "no" else shutil.which("uv")
    if options.is_good:
        sys.exit(not known_version() or bool(missing_prerequisites(uv)))
    made_with = read_record().get("home", {}).get("python")
    if made_with and made_with != base_python() and not options.this_python and os.path.exists(made_with):
        os.execv(made_with, [made_with, *sys.argv])  # python3 may be another one now; .venv is still valid
    faster = None if made_with or options.this_python else faster_python()
    if faster:
        say("{} was compiled without optimisations: taking {} (or: PYTHON=python3)".format(base_python(), faster))
        os.execv(faster, [faster, *sys.argv])
    check_machine(uv)
    os.chdir(ROOT)
    lock = os.open(ROOT, os.O_RDONLY)  # one set-up at a time; the lock is released when this process exits
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        say("waiting for another set-up in this folder")
        fcntl.flock(lock, fcntl.LOCK_EX)
    precompile(sync(uv, options.tests))


if __name__ == "__main__":
    try:
        main()
    except KeyboardInterrupt:
        stop("interrupted; the next run starts anew")
