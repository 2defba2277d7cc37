#!/usr/bin/env python3
"""Checks the links between the Markdown files of the repository: files exist, and so do the headings that are named.

usage: check_links.py ROOT...   (folders; links may lead anywhere below the first one). Exit status 1 if one is broken.
"""
import os
import re
import sys

LINK = re.compile(r"\]\(([^()\s]+)\)")


def without_code(text):
    """The text without blocks and spans of code, where brackets mean something else."""
    return re.sub(r"`[^`\n]*`", "", re.sub(r"^```.*?^```", "", text, flags=re.M | re.S))


def anchors(path):
    """The anchors of a page's headings."""
    with open(path, encoding="utf-8") as file:
        headings = re.findall(r"^#+ (.+)$", re.sub(r"^```.*?^```", "", file.read(), flags=re.M | re.S), re.M)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


def broken(path, root):
    """The broken links of a page, with the reason."""
    with open(path, encoding="utf-8") as file:
        links = LINK.findall(without_code(file.read()))
    for link in links:
        if re.match(r"[a-z]+:", link):
            continue
        target, _, anchor = link.partition("#")
        there = os.path.normpath(os.path.join(os.path.dirname(path), target)) if target else path
        if os.path.relpath(there, root).startswith("..") or not os.path.exists(there):
            yield f"{path}: {link}: no such file"
        elif anchor and (not there.endswith(".md") or anchor not in anchors(there)):
            yield f"{path}: {link}: no such heading"


def main(roots):
    pages, faults = 0, []
    for root in roots:
        for folder, folders, files in os.walk(root):
            folders[:] = [name for name in folders if not name.startswith((".", "build", "gpu-"))]
            for name in files:
                if name.endswith(".md"):
                    pages += 1
                    faults += broken(os.path.join(folder, name), roots[0])
    print("\n".join([*faults, f"check_links: {pages} pages, {len(faults)} broken links"]))
    return 1 if faults or pages == 0 else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
