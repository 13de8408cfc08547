#!/usr/bin/env bash
# Runs schemathesis against the service: `fuzz_api.sh BINARY VENV`. Answers and documentation must agree.
set -euo pipefail
binary=$1
venv=$2
here=$(cd "$(dirname "$0")" && pwd)
PYTHONPATH=$here "$venv/bin/python" - "$binary" "$venv/bin/schemathesis" <<'PYTHON'
import subprocess
import sys

from service import Service

binary, schemathesis = sys.argv[1:]
with Service(binary) as service:
    subprocess.run(
        [schemathesis, "run", service.url + "/openapi.yaml", "--max-examples", "40", "--seed", "1", "--workers", "2",
         "--request-timeout", "30", "--max-failures", "20"],
        check=True, timeout=300)
PYTHON
