"""Does what the README says: runs the commands of its `console` blocks and compares what they print.

    python readme.py BINARY             fails where something differs
    python readme.py BINARY --update    writes what they print into the README

Ids of jobs, times and names of workers differ from run to run and are not compared; labels and energies must be the same everywhere.
"""

import pathlib
import re
import subprocess
import sys
import tempfile

from service import Service

README = pathlib.Path(__file__).resolve().parents[2] / "README.md"
BLOCK = re.compile(r"^```console\n(.*?)^```$", re.MULTILINE | re.DOTALL)
MARK = "--- end of output ---"


def print_of(commands, service, binary, folder):
    """What each command prints, all run by one shell."""
    script = "".join(f"{command}\necho '{MARK}'\n" for command in commands)
    script = script.replace("http://127.0.0.1:8080", service.url).replace("target/release/tesserae", str(binary))
    done = subprocess.run(["bash", "-e"], input=script, cwd=folder, capture_output=True, text=True)
    assert done.returncode == 0 and not done.stderr, f"{done.stdout}\n{done.stderr}"
    return done.stdout.split(MARK + "\n")[:-1]


def stable(text):
    """Without what differs from run to run."""
    text = re.sub(r"[0-9a-f]{8}(-[0-9a-f]{4}){3}-[0-9a-f]{12}", "JOB", text)
    text = re.sub(r'"elapsed_us":\d+', '"elapsed_us":N', text)
    text = re.sub(r'"worker":"[^"]*"', '"worker":"NAME"', text)
    return re.sub(r"[0-9.]+ s on .*", "TIME", text)


def main(binary, update):
    text = README.read_text()
    with Service(binary) as service, tempfile.TemporaryDirectory() as folder:
        blocks = BLOCK.findall(text)
        commands = [[line[2:] for line in block.splitlines() if line.startswith("$ ")] for block in blocks]
        printed = iter(print_of(sum(commands, []), service, binary, folder))
    for block, of_block in zip(blocks, commands):
        now = "".join(f"$ {command}\n{next(printed)}" for command in of_block)
        if update:
            text = text.replace(block, now)
        else:
            assert stable(now) == stable(block), f"the README says\n{block}\nbut it is\n{now}"
    assert sum(commands, []), "the README has no commands"
    if update:
        README.write_text(text)


if __name__ == "__main__":
    main(pathlib.Path(sys.argv[1]).resolve(), "--update" in sys.argv[2:])
