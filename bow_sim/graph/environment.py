"""What a process inherits from its caller: open files, signals, environment variables.

Imports the standard library only, and little of it: a command calls :func:`prepare` before it imports anything else.
"""

from __future__ import annotations

import importlib.util
import os
import signal
import sys
from collections.abc import Iterable, Mapping

RMW, DOMAIN, PROFILE = "RMW_IMPLEMENTATION", "ROS_DOMAIN_ID", "FASTRTPS_DEFAULT_PROFILES_FILE"
MIDDLEWARE = "rmw_fastrtps_cpp"
MAX_DOMAIN = 232
"""From domain 233 on, the ports would be above 65535."""

BOOTSTRAPPED = "_ROS_WHEELS_BOOTSTRAP_COMPLETE"
"""Tells ROS wheels that LD_LIBRARY_PATH has their libraries; an inherited value may be that of another Python."""

AT_START = ("LD_LIBRARY_PATH", "PYTHONPATH", "PYTHONWARNINGS")
"""Variables that are read only when a process starts: to change them, the process must be started again."""

BLAS_THREADS = "OPENBLAS_NUM_THREADS"
"""Read when NumPy and SciPy are loaded: each starts this many threads for linear algebra, which nothing here uses much.
By default there is one for each core, and all but the first spin for some 0.1 s in each process that loads them."""

_STARTED_AGAIN = "_BOW_STARTED_AGAIN"

PAINTER_SOCKET = "_BOW_PAINTER_SOCKET"
"""Set by `bow sweep` for its coordinator alone: descriptor of a socket to the process that draws the picture."""

_LIBRARIES = ("librcl", "librcutils", "librmw", "librosidl", "libfastrtps", "libfastdds", "libfastcdr")
_PACKAGES = ("rclpy", "rpyutils", "rosidl_", "ament_", "rosbag2_")
_INTERFACES = ("_msgs", "_interfaces", "_srvs")


_NEEDED = {"rclpy": "ROS 2 for Python", "bow_msgs": "the messages of the graph"}


class EnvironmentProblem(ValueError):
    """Something with which the graph cannot work; the text names it, and what would be right."""


def prepare() -> None:
    """Make this process independent of its caller; a command calls it first.

    If variables of :data:`AT_START` are wrong, the same command is started again in this process (execve).
    """
    open_streams()
    _leave_removed_directory()
    if signal.getsignal(signal.SIGCHLD) is signal.SIG_IGN:  # exit statuses of children would be lost
        signal.signal(signal.SIGCHLD, signal.SIG_DFL)
    _find_title()
    again = os.environ.pop(_STARTED_AGAIN, "")
    right = cleaned(os.environ)
    wrong = [name for name in AT_START if right.get(name) != os.environ.get(name)]
    if wrong and not again:
        os.execve(sys.executable, [sys.executable, *sys.orig_argv[1:]], {**right, _STARTED_AGAIN: "1"})
    _replace(right)


def _find_title() -> None:
    """Let setproctitle find the memory of the process title; it cannot after the environment has changed."""
    try:
        import setproctitle
    except ImportError:
        return
    setproctitle.getproctitle()


def _leave_removed_directory() -> None:
    """Leave a working directory that was removed, because libraries ask for it; no file can be created in /proc."""
    try:
        os.getcwd()
    except OSError:
        os.chdir("/proc")


def _replace(right: Mapping[str, str]) -> None:
    for name in os.environ.keys() - right.keys():
        del os.environ[name]
    os.environ.update(right)


def open_streams() -> None:
    """Open those of standard input, output and error that are closed, on /dev/null.

    Otherwise the next files or sockets get their descriptors, and libraries would print into them.
    """
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            opened = os.open(os.devnull, os.O_RDWR)  # gets the lowest free descriptor
            os.set_inheritable(opened, True)
    for name, mode in (("stdin", "r"), ("stdout", "w"), ("stderr", "w")):
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, mode, encoding="utf-8"))  # noqa: SIM115


def silence(name: str) -> None:
    """Redirect "stdout" or "stderr" to /dev/null after an error of writing, so that Python exits quietly."""
    try:
        os.dup2(os.open(os.devnull, os.O_WRONLY), getattr(sys, name).fileno())
    except (OSError, ValueError, AttributeError):  # not a real file, for example in a notebook
        return


def cleaned(environment: Mapping[str, str]) -> dict[str, str]:
    """Return an environment without variables that would make our processes load other libraries.

    With ROS from wheels these are the variables set by a sourced ROS installation, or by another Python with wheels. In
    a ROS workspace they name the installation that is used, and stay.
    """
    right = dict(environment)
    right["NUMBA_DISABLE_JIT"] = "0"  # the kernels exist only compiled
    right["SKIP_DEFAULT_XML_FILE"] = "1"  # Fast DDS would read a profile from the working directory
    right.setdefault(BLAS_THREADS, "1")
    if right.get("PYTHONWARNINGS", "").startswith("error"):
        del right["PYTHONWARNINGS"]
    python = right.get("PYTHONPATH", "").split(os.pathsep)
    libraries = wheel_libraries()
    if libraries:
        right.pop("AMENT_PREFIX_PATH", None)
        right[BOOTSTRAPPED] = "1"
        given = [entry for entry in right.get("LD_LIBRARY_PATH", "").split(os.pathsep) if entry]
        others = [entry for entry in given if entry not in libraries and not _has_libraries(entry)]
        if set(given) != {*libraries, *others}:
            right["LD_LIBRARY_PATH"] = os.pathsep.join([*libraries, *others])
        python = [entry for entry in python if not _has_packages(entry)]
    python = [entry for entry in python if entry]  # an empty entry means the working directory
    if python:
        right["PYTHONPATH"] = os.pathsep.join(python)
    else:
        right.pop("PYTHONPATH", None)
    return right


def wheel_libraries() -> list[str]:
    """Return the directories with the libraries of this Python's ROS wheels; empty if ROS is not from wheels."""
    prefix = os.path.join(sys.prefix, "lib")
    packages = os.path.join(prefix, f"python{sys.version_info.major}.{sys.version_info.minor}", "site-packages")
    names = _names(packages)
    if "ros_wheels_bootstrapper" not in names:
        return []
    bundled = sorted(name for name in names if name.startswith("ros_") and name.endswith(".libs"))
    return [prefix, *(os.path.realpath(os.path.join(packages, name)) for name in bundled)]


def _names(directory: str) -> list[str]:
    try:
        return os.listdir(directory)
    except OSError:
        return []


def _has_libraries(directory: str) -> bool:
    return any(name.startswith(_LIBRARIES) and ".so" in name for name in _names(directory))


def _has_packages(directory: str) -> bool:
    return any(name.startswith(_PACKAGES) or name.endswith(_INTERFACES) for name in _names(directory) if directory)


def clean() -> str:
    """Correct the environment of this process for a graph; call it before processes or directories are created.

    Returns
    -------
    str
        A text for the user on what is set and ignored; "" if nothing is.

    Raises
    ------
    EnvironmentProblem
        As :func:`check`, and where a Python package of ROS is not installed.
    """
    for name, what in _NEEDED.items():
        if importlib.util.find_spec(name) is None:
            raise EnvironmentProblem(
                f"no graph starts without the package {name}, {what}, which {sys.executable} does not find: use the "
                "Python in which ROS 2 and bow_msgs are installed, or install them, as docs/install.md says"
            )
    check(os.environ)
    right = cleaned(os.environ)
    asked = right.pop(RMW, "")
    _replace(right)
    return f"{RMW}={asked} is ignored: bow needs {MIDDLEWARE}" if asked not in ("", MIDDLEWARE) else ""


def check(environment: Mapping[str, str]) -> None:
    """Raise an error if no graph can start in an environment.

    Raises
    ------
    EnvironmentProblem
        The text names the variable, its value and what would be right.
    """
    for problem in _problems(environment):
        raise EnvironmentProblem(problem)


def _problems(given: Mapping[str, str]) -> Iterable[str]:
    domain = given.get(DOMAIN, "").strip()
    if domain and not (domain.isascii() and domain.isdigit() and int(domain) <= MAX_DOMAIN):
        yield f"{DOMAIN}={domain}: should be a whole number, 0 ... {MAX_DOMAIN}, or not set"
    for name in ("RCUTILS_LOGGING_USE_STDOUT", "RCUTILS_LOGGING_BUFFERED_STREAM", "RCUTILS_COLORIZED_OUTPUT"):
        if given.get(name, "") not in ("", "0", "1"):
            yield f"{name}={given[name]}: should be 0 or 1, or not set"
    yield from _discovery_problems(given)
    yield from _profile_problems(given)
    if given.get("ROS_SECURITY_ENABLE") == "true" and given.get("ROS_SECURITY_STRATEGY") == "Enforce":
        store = given.get("ROS_SECURITY_KEYSTORE", "")
        if not os.path.isdir(os.path.join(store, "enclaves")):
            yield (
                f"ROS_SECURITY_ENABLE=true, ROS_SECURITY_STRATEGY=Enforce: ROS_SECURITY_KEYSTORE={store} has no keys "
                "(a directory `enclaves`) for these nodes; make some with `ros2 security`, or unset ROS_SECURITY_ENABLE"
            )


def _discovery_problems(given: Mapping[str, str]) -> Iterable[str]:
    reach = given.get("ROS_AUTOMATIC_DISCOVERY_RANGE", "")
    reaches = ("SUBNET", "LOCALHOST", "OFF", "SYSTEM_DEFAULT")
    if reach and reach.upper() not in reaches:
        yield f"ROS_AUTOMATIC_DISCOVERY_RANGE={reach}: should be one of {', '.join(reaches)}, or not set"
    for peer in filter(None, given.get("ROS_STATIC_PEERS", "").split(";")):
        import socket

        try:
            socket.getaddrinfo(peer, None)
        except (OSError, UnicodeError) as error:
            why = getattr(error, "strerror", None) or error
            yield f"ROS_STATIC_PEERS: {peer!r}: {why}; should be names or addresses of machines, separated by ;"


def _profile_problems(given: Mapping[str, str]) -> Iterable[str]:
    path = given.get(PROFILE, "")
    if not path:
        return
    from xml.etree import ElementTree

    try:
        ElementTree.parse(path)
    except (OSError, ElementTree.ParseError) as error:
        why = getattr(error, "strerror", None) or error
        yield f"{PROFILE}={path}: {why}; should be an XML file of Fast DDS, or not set: bow has its own"
