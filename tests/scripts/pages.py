"""Runs the commands of the `console` blocks of README and guide, and compares what they print.

    python pages.py BINARY             fails where something differs
    python pages.py BINARY --update    writes what the commands print into the pages

The commands of a page share a shell and a folder. Ids of jobs and times differ from run to run and are not compared; labels
and energies must be the same everywhere.
"""

import pathlib
import re
import subprocess
import sys
import tempfile

from service import Service

ROOT = pathlib.Path(__file__).resolve().parents[2]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
BLOCK = re.compile(r"^```console\n(.*?)^```$", re.MULTILINE | re.DOTALL)
MARK = "--- end of output ---"
README_BYTES = 10_000


def commands_of(block):
    return [line[2:] for line in block.splitlines() if line.startswith("$ ")]


def print_of(commands, service, binary):
    """What each command prints, all run by one shell in a folder of their own."""
    script = "".join(f"{command}\necho '{MARK}'\n" for command in commands)
    script = script.replace("http://127.0.0.1:8080", service.url).replace("target/release/tesserae", str(binary))
    with tempfile.TemporaryDirectory() as folder:
        done = subprocess.run(["bash", "-e"], input=script, cwd=folder, capture_output=True, text=True)
    assert done.returncode == 0 and not done.stderr, f"{done.stdout}\n{done.stderr}"
    return done.stdout.split(MARK + "\n")[:-1]


def stable(text):
    """Without what differs from run to run."""
    text = re.sub(r"[0-9a-f]{8}(-[0-9a-f]{4}){3}-[0-9a-f]{12}", "JOB", text)
    text = re.sub(r'"elapsed_us":\d+', '"elapsed_us":N', text)
    return re.sub(r"[0-9.]+ s on .*", "TIME", text)


def check(page, service, binary, update):
    """Number of commands of a page; fails where a command prints something else than the page says."""
    text = page.read_text()
    blocks = BLOCK.findall(text)
    commands = [commands_of(block) for block in blocks]
    printed = iter(print_of(sum(commands, []), service, binary))
    for block, of_block in zip(blocks, commands):
        now = "".join(f"$ {command}\n{next(printed)}" for command in of_block)
        if update:
            text = text.replace(block, now)
        else:
            assert stable(now) == stable(block), f"{page.name} says\n{block}\nbut it is\n{now}"
    if update:
        page.write_text(text)
    return sum(map(len, commands))


def check_links(page):
    """Fails where a page links to a file that is not there."""
    for target in re.findall(r"\]\(([^)#]+)(?:#[^)]*)?\)", page.read_text()):
        assert "://" in target or (page.parent / target).exists(), f"{page.name} links to {target}, which is missing"


def main(binary, update):
    assert len(PAGES[0].read_bytes()) <= README_BYTES, f"README.md is a front page of at most {README_BYTES} bytes"
    for page in PAGES:
        check_links(page)
    with Service(binary) as service:
        counts = {page.name: check(page, service, binary, update) for page in PAGES}
    for page in ("README.md", "hierarchies.md"):
        assert counts[page], f"{page} has no commands"
    print(f"{sum(counts.values())} commands of {len(PAGES)} pages print what the pages say")


if __name__ == "__main__":
    main(pathlib.Path(sys.argv[1]).resolve(), "--update" in sys.argv[2:])
