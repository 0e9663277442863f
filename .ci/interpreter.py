"""Whether this interpreter can run Lorecrawl: prints its version and what stands in the way,
and exits with 1 if something does.

Runs on any Python, however old. `.ci/lock` proves that each locked package has a wheel for what is
let through here.
"""

import platform
import struct
import sys
import sysconfig

PYTHONS = (11, 12, 13, 14)  # 3.x
PLATFORMS = (("Linux", "x86_64"), ("Linux", "aarch64"), ("Darwin", "arm64"))
GLIBC = (2, 28)
MACOS = (14, 0)


def version(text):
    """(2, 28) of "2.28"; () of ""."""
    return tuple(int(part) for part in text.split(".")[:2] if part.isdigit())


def obstacle():
    """What stands in the way, in a few words; empty where nothing does."""
    system, machine = platform.system(), platform.machine()
    if sys.version_info < (3, PYTHONS[0]):
        return "too old"
    if sys.version_info >= (3, PYTHONS[-1] + 1):
        return "too new"
    if platform.python_implementation() != "CPython":
        return platform.python_implementation()
    if sysconfig.get_config_var("Py_GIL_DISABLED"):
        return "free-threaded"
    if struct.calcsize("P") != 8:
        return "32 bits"
    if (system, machine) not in PLATFORMS:
        return "%s %s" % (system, machine)  # noqa: UP031
    if system == "Linux":
        libc, its_version = platform.libc_ver()
        if libc != "glibc" or version(its_version) < GLIBC:
            return ("%s %s" % (libc or "no glibc", its_version)).strip()  # noqa: UP031
    if system == "Darwin" and version(platform.mac_ver()[0]) < MACOS:
        return "macOS " + platform.mac_ver()[0]
    return ""


if __name__ == "__main__":
    found = obstacle()
    print(platform.python_version() + (" (" + found + ")" if found else ""))
    sys.exit(bool(found))
