"""Draws the pictures of the guides anew: `python render_guides.py`. The Python code on a page draws its picture."""

import os
import pathlib
import re

FOLDER = pathlib.Path(__file__).resolve().parent
GUIDES = ["images.md", "volumes.md", "maps.md", "clouds.md"]

if __name__ == "__main__":
    os.chdir(FOLDER)
    for guide in GUIDES:
        blocks = re.findall(r"```python\n(.*?)```", (FOLDER / guide).read_text(encoding="utf-8"), flags=re.DOTALL)
        exec(compile("\n".join(blocks), guide, "exec"), {})
