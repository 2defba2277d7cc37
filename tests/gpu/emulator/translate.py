#!/usr/bin/env python3
"""usage: translate.py CORE_CUDA_DIR OUT_DIR

Copies core/cuda for the emulator: kernel launches become calls, shared memory becomes static memory.
"""
import pathlib
import re
import sys

LAUNCH = re.compile(r"([A-Za-z_][\w:]*(?:<[^<>;=]*>)?)<<<(.*?)>>>\(", re.S)


def closing(text, begin):
    """Index of the bracket that closes the one before `begin`."""
    depth = 1
    for i in range(begin, len(text)):
        depth += {"(": 1, ")": -1}.get(text[i], 0)
        if depth == 0:
            return i
    raise ValueError("unbalanced brackets")


def launches(text):
    out, at = [], 0
    while match := LAUNCH.search(text, at):
        end = closing(text, match.end())
        arguments = text[match.end():end].strip()
        out.append(text[at:match.start()])
        # A lambda, since the kernel may be a template whose parameters its arguments name.
        out.append(f"::cuda_emulator::Launch(::cuda_emulator::Config{{{match[2]}}}, "
                   f"[&](auto... passed_on) {{ {match[1]}(passed_on...); }}" + (f", {arguments}" if arguments else "") + ")")
        at = end + 1
    return "".join(out) + text[at:]


# What a kernel that begins early says of itself (dependent_launch.cuh).
EARLY = re.compile(r"#if defined\(__CUDA_ARCH__\)[^\n]*\n\s*asm volatile\(\"griddepcontrol\.(\w+);\"[^\n]*\n#endif")
EARLY_CALLS = {"wait": "AwaitEarlier", "launch_dependents": "AllowNext"}


def translate(text):
    text = EARLY.sub(lambda m: f"  ::cuda_emulator::races::{EARLY_CALLS[m[1]]}();", text)
    text = re.sub(r"extern __shared__ (?:alignas\([^)]*\) )?([\w ]+?) (\w+)\[\];",
                  r"\1* const \2 = static_cast<\1*>(::cuda_emulator::DynamicShared());", text)
    text = re.sub(r"__shared__ (alignas\([^)]*\) )?", lambda m: (m[1] or "") + "static ", text)
    return launches(text)


def main():
    source, target = pathlib.Path(sys.argv[1]), pathlib.Path(sys.argv[2])
    for path in source.rglob("*"):
        if path.suffix not in (".cu", ".cuh", ".h", ".cpp"):
            continue
        room = target / path.parent.relative_to(source)
        room.mkdir(parents=True, exist_ok=True)
        name = path.name + ".cpp" if path.suffix == ".cu" else path.name
        (room / name).write_text(f'#line 1 "{path}"\n' + translate(path.read_text()))


if __name__ == "__main__":
    main()
