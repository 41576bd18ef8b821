#!/usr/bin/env python3
"""Counts the rooms of the tree and the imports between them.

In: the sources of a checkout, read as text (`use` declarations and paths that begin with `crate::`, `super::` or the
name of one of our crates). A room is a folder of sources; a file beside others in a crate's root is a room of its own.
Out: rooms, floors (the longest way along imports), arrows between rooms, arrows that are part of a circle, circles of
files, and lines by room. Tests are left out. Imports made by macros and re-exports are not followed.

    tools/rooms.py                 the whole tree
    tools/rooms.py host/src        what lies below a folder
    tools/rooms.py --arrows        every arrow between rooms, with the files that make it
    tools/rooms.py --budget        lines, words, packages and constants against tools/budgets.toml; exit 1 above
"""

import argparse
import re
import sys
from collections import defaultdict
from pathlib import Path

import room_budgets

CRATES = {
    "headway_protocol": "protocol/src",
    "headway_firmware": "firmware/src",
    "headway_geometry": "host/geometry/src",
    "headway_optimiser": "host/optimiser/src",
    "headway_reach": "host/reach/src",
    "headway_plan": "host/plan/src",
    "headway": "host/src",
}
# `headway::geometry` and `headway::reach` are the crates of these names.
AGAIN = {("host/src", "geometry"): "host/geometry/src", ("host/src", "reach"): "host/reach/src"}


def is_test(path):
    name = path.name
    return "tests" in path.parts or name.endswith("tests.rs") or name.startswith("test_")


def code_of(path):
    """The text without comments and without a closing `mod tests { .. }`."""
    lines = []
    all_lines = path.read_text().splitlines()
    for number, line in enumerate(all_lines):
        following = all_lines[number + 1] if number + 1 < len(all_lines) else ""
        if line == "#[cfg(test)]" and re.match(r"(pub )?mod \w+ \{", following):
            break
        if not line.lstrip().startswith("//"):
            lines.append(line)
    return "\n".join(lines)


def expanded(tree):
    """`a::{b, c::{d}}` as `a::b`, `a::c::d`."""
    tree = tree.strip()
    brace = tree.find("{")
    if brace < 0:
        return [tree.split(" as ")[0].strip()]
    head, body = tree[:brace], tree[brace + 1 : tree.rfind("}")]
    parts, depth, begin = [], 0, 0
    for at, char in enumerate(body + ","):
        depth += (char == "{") - (char == "}")
        if char == "," and depth == 0:
            parts.append(body[begin:at])
            begin = at + 1
    return [head + path for part in parts if part.strip() for path in expanded(part)]


def named_paths(code):
    for use in re.finditer(r"\buse\s+([^;]+);", code):
        yield from expanded(re.sub(r"\s+", " ", use.group(1)))
    bare = re.sub(r"\buse\s+[^;]+;", "", code)
    names = "|".join(["crate", "super", *CRATES])
    for found in re.finditer(rf"\b(?:{names})(?:::\w+)+", bare):
        yield found.group(0)


def root_of(path):
    return next((root for root in sorted(CRATES.values(), key=len, reverse=True) if path.is_relative_to(root)), None)


def module_of(path):
    """The folder in which the modules below this file lie."""
    return path.parent if path.name in ("mod.rs", "lib.rs", "main.rs") else path.with_suffix("")


def file_of(words, folder, files):
    """The file that the longest beginning of a path names."""
    found = None
    for word in words:
        folder = folder / word
        if folder.with_suffix(".rs") in files:
            found = folder.with_suffix(".rs")
        elif folder / "mod.rs" in files:
            found = folder / "mod.rs"
        else:
            break
    return found


def target_of(path, named, files):
    words = named.split("::")
    folder = None
    if words[0] in CRATES:
        folder, words = Path(CRATES[words[0]]), words[1:]
    elif words[0] == "crate":
        folder, words = Path(root_of(path)), words[1:]
    elif words[0] in ("super", "self"):
        folder = module_of(path)
        while words and words[0] in ("super", "self"):
            folder = folder.parent if words[0] == "super" else folder
            words = words[1:]
    else:
        folder = module_of(path)
    if words and (str(folder), words[0]) in AGAIN:
        folder, words = Path(AGAIN[(str(folder), words[0])]), words[1:]
    found = file_of(words, folder, files)
    if found is None and named.split("::")[0] in ("crate", "super", *CRATES):
        for own in (folder / "mod.rs", folder / "lib.rs", folder.with_suffix(".rs")):
            if own in files:
                return own
    return found


def circles_of(arrows):
    """Strongly connected components of more than one node (Tarjan, 1972), without recursion."""
    index, low, stack, on_stack, found = {}, {}, [], set(), []
    for begin in sorted(arrows):
        if begin in index:
            continue
        work = [(begin, iter(sorted(arrows[begin])))]
        index[begin] = low[begin] = len(index)
        stack.append(begin)
        on_stack.add(begin)
        while work:
            node, rest = work[-1]
            for to in rest:
                if to not in index:
                    index[to] = low[to] = len(index)
                    stack.append(to)
                    on_stack.add(to)
                    work.append((to, iter(sorted(arrows.get(to, ())))))
                    break
                if to in on_stack:
                    low[node] = min(low[node], index[to])
            else:
                work.pop()
                if work:
                    low[work[-1][0]] = min(low[work[-1][0]], low[node])
                if low[node] == index[node]:
                    circle = set()
                    while node not in circle:
                        circle.add(stack.pop())
                    on_stack -= circle
                    found.append(circle)
    return found


def floors_of(arrows):
    """The floor of each room: one above the highest that it imports; rooms of a circle share theirs."""
    circles = circles_of(arrows)
    of = {node: number for number, circle in enumerate(circles) for node in circle}
    # Tarjan's order: what is imported comes first.
    floors = []
    for number, circle in enumerate(circles):
        below = [floors[of[to]] for node in circle for to in arrows[node] if of[to] != number]
        floors.append(1 + max(below, default=0))
    return {node: floors[of[node]] for node in of}


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", nargs="?", default=".")
    parser.add_argument("--depth", type=int, default=1, help="folders below a crate's root that are rooms of their own")
    parser.add_argument("--arrows", action="store_true")
    parser.add_argument("--budget", action="store_true")
    parser.add_argument("--lower", action="store_true", help="with --budget: write down what can go down")
    parser.add_argument("--write", action="store_true", help="with --budget: set every budget to its figure")
    options = parser.parse_args()
    if options.budget:
        sys.exit(room_budgets.main(is_test, options.lower, options.write))
    files = {path for root in CRATES.values() for path in Path(root).rglob("*.rs") if not is_test(path)}
    shown = {path for path in files if path.is_relative_to(options.folder) or options.folder == "."}

    def room(path):
        root = root_of(path)
        below = path.relative_to(root).parts
        return "/".join([root, *below[: options.depth]]) if len(below) > options.depth else str(path)

    imports, lines = defaultdict(set), defaultdict(int)
    for path in sorted(shown):
        code = code_of(path)
        lines[room(path)] += len(path.read_text().splitlines())
        for named in named_paths(code):
            to = target_of(path, named, files)
            if to is not None and to != path and to in shown:
                imports[path].add(to)
        imports.setdefault(path, set())
    arrows = defaultdict(set)
    why = defaultdict(list)
    for path, targets in imports.items():
        arrows.setdefault(room(path), set())
        for to in targets:
            if room(to) != room(path):
                arrows[room(path)].add(room(to))
                why[room(path), room(to)].append(f"{path} -> {to}")
    floors = floors_of(arrows)
    in_circles = [circle for circle in circles_of(arrows) if len(circle) > 1]
    file_circles = [circle for circle in circles_of(imports) if len(circle) > 1]
    for name in sorted(arrows, key=lambda name: (-floors[name], name)):
        print(f"floor {floors[name]:2}  {lines[name]:6} lines  {name}")
    count = sum(len(targets) for targets in arrows.values())
    print(f"{len(arrows)} rooms, {max(floors.values(), default=0)} floors, {count} arrows")
    print(f"{sum(lines.values())} lines without files of tests")
    for circle in in_circles:
        print("circle of rooms: " + ", ".join(sorted(circle)))
    print(f"{len(file_circles)} circles of files, in them {sum(map(len, file_circles))} files")
    if options.arrows:
        for (begin, to), files_of in sorted(why.items()):
            print(f"{begin} -> {to}: " + "; ".join(sorted(files_of)))


if __name__ == "__main__":
    main()
