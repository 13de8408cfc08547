"""The command line: ``python -m tesserae_mesh`` and the script ``tesserae``."""

from __future__ import annotations

import signal
import sys


def main() -> int:
    """Run the command that the arguments of this process name; return its exit status."""
    from tesserae_mesh import _native

    # The command handles signals as it does without Python, which would add a traceback.
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    return _native.main(["tesserae", *sys.argv[1:]])


if __name__ == "__main__":
    sys.exit(main())
