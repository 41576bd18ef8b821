#!/usr/bin/env python3
"""Do the tests notice when the product is wrong? Run by hand, hours for the whole list:

    tools/mutate.py run                     every place of tools/mutations.toml
    tools/mutate.py run --only 3 --only 17  some of them
    tools/mutate.py run --stages 1          only the first command of each place, without the long ones
    tools/mutate.py check                   whether each place is still there and compiles
    tools/mutate.py draw                    draws places anew with the list's seed and prints them

In: 30 places drawn with a fixed seed over the product's lines, so that large rooms have more of them: a comparison that
includes its bound, a sign, a constant times 1.1, a dropped `!`, an early return. Method: each is written into a worktree
of the last commit below target/mutations, and the commands of its room run there, cheapest first, until one fails or
takes longer than its limit. Out: a row for each place, caught or survived, and the count. A place is found by the text
of its line: in its file, or elsewhere in the product if that line exists once; what is gone is said and counts as neither.
The checkout is only read. CARGO_PROFILE_DEV_OPT_LEVEL and the like reach the builds.
"""

import argparse
import os
import random
import re
import signal
import subprocess
import sys
import time
import tomllib
from collections import defaultdict
from pathlib import Path

import room_budgets
from rooms import is_test

ROOT = Path(__file__).resolve().parent.parent
LIST = ROOT / "tools/mutations.toml"
WORK = ROOT / "target/mutations"
TREE = WORK / "tree"
# A build that hangs.
BUILD_S_MAX = 3600
COUNT = 30
# What a line's change can be: name, what is found, what takes its place.
CHANGES = [
    ("includes its bound", r"(?<= )<(?= )", "<="),
    ("includes its bound", r"(?<= )>(?= )", ">="),
    ("the other way", r"(?<= )<(?= )", ">"),
    ("the other way", r"(?<= )>(?= )", "<"),
    ("excludes its bound", r"(?<= )<=(?= )", "<"),
    ("excludes its bound", r"(?<= )>=(?= )", ">"),
    ("sign", r"(?<= )\+(?= )", "-"),
    ("sign", r"(?<= )-(?= )", "+"),
    ("either in place of both", r"(?<= )&&(?= )", "||"),
    ("dropped not", r"(?<=[ (])!(?=[a-z(])", ""),
    ("greatest in place of least", r"\.min\(", ".max("),
    ("least in place of greatest", r"\.max\(", ".min("),
]
# Lines in which a change is no change of what the product does.
LEFT_OUT = re.compile(r'"|//|#\[|assert|\bwhere\b|\bimpl\b|\buse\b|\bdyn\b|\btrait\b|\btype\b|: [A-Z]\w*<|\+ \'|\+ S(end|ync)')
CONSTANT = re.compile(r"^(?:pub(?:\(\w+\))? )?const [A-Z_0-9]+: f64 = ([\d._]+);$")
FUNCTION = re.compile(r"^(?:pub(?:\(\w+\))? )?fn \w+(?:<[^>]*>)?\((?:[^()]|\([^()]*\))*\)(?: -> (bool|Option<.*>|f64))? \{$")
EARLY = {None: "return;", "bool": "return false;", "f64": "return 0.0;"}


def product_files(root):
    """Lines of each product file, tests and texts of several lines blank; programs of boards are not among what tests run."""
    blank = lambda text: re.sub(r"[^\n]", " ", text)
    listed = subprocess.run(["git", "ls-files", "*.rs"], cwd=root, capture_output=True, text=True, check=True)
    for name in listed.stdout.splitlines():
        path = Path(name)
        if not name.startswith(room_budgets.PRODUCT) or is_test(path):
            continue
        if "bin" in path.parts or "examples" in path.parts or path.name in ("build.rs", "main.rs"):
            continue
        text = (root / path).read_text()
        for begin, end in list(room_budgets.items_of_tests(text)):
            text = text[:begin] + blank(text[begin:end]) + text[end:]
        text = room_budgets.TOKEN.sub(lambda token: blank(token[0]) if "\n" in token[0] else token[0], text)
        yield name, text.splitlines()


def changes_of(line):
    """What can be made of a line: the kind and the new text."""
    if constant := CONSTANT.match(line):
        value = float(constant.group(1).replace("_", ""))
        yield "constant", line.replace(f"= {constant.group(1)};", f"= {round(value * 1.1, 12)!r};")
    if function := FUNCTION.match(line):
        given = function.group(1)
        yield "early return", f"{line} {EARLY.get(given, 'return None;')}"
    if LEFT_OUT.search(line) or CONSTANT.match(line) or FUNCTION.match(line):
        return
    for kind, sign, other in CHANGES:
        # Points have a difference and no sum.
        for found in re.finditer(sign, line) if (kind, other) != ("sign", "+") or "point" not in line else ():
            yield kind, line[: found.start()] + other + line[found.end() :]


def draw(seed):
    """Places: thirty lines at equal distances from a drawn one on, files by name, so that rooms have their share; of the file
    that holds one a kind of change that it offers, and a line for it."""
    files = list(product_files(ROOT))
    weights = [sum(bool(line.strip()) for line in lines) for _, lines in files]
    chance = random.Random(seed)
    step = sum(weights) / COUNT
    offset = chance.random()
    marks = [(offset + k) * step for k in range(COUNT)]
    found, done, due = [], 0, 0
    for (name, lines), weight in zip(files, weights):
        # A file without a line that can be changed leaves its place to the next one.
        due += sum(done <= mark < done + weight for mark in marks)
        done += weight
        texts = [line.strip() for line in lines]
        # A line that its file has twice could not be found again.
        once = [text for text in texts if texts.count(text) == 1]
        able = defaultdict(list)
        for line in once:
            for kind, into in changes_of(line):
                able[kind].append((line, into))
        while due and able:
            due -= 1
            kind = chance.choice(sorted(able))
            line, into = chance.choice(able.pop(kind))
            found.append({"file": name, "kind": kind, "find": line, "replace": into})
    return found


def located(place, files):
    """File and number of the line of a place; `None` where it is gone."""
    found = [
        (name, number)
        for name, lines in files.items()
        for number, line in enumerate(lines)
        if line.strip() == place["find"]
    ]
    own = [at for at in found if at[0] == place["file"]]
    chosen = own or found
    return chosen[0] if len(chosen) == 1 else None


def git(*words):
    subprocess.run(["git", *words], cwd=ROOT, check=True, capture_output=True)


def make_tree():
    WORK.mkdir(parents=True, exist_ok=True)
    if TREE.exists():
        remove_tree()
    # By force where a run that was killed left its entry behind.
    git("worktree", "add", "--force", "--detach", str(TREE), "HEAD")
    shared = WORK / "shared"
    if (ROOT / "../shared").exists() and not shared.exists():
        shared.symlink_to((ROOT / "../shared").resolve())


def remove_tree():
    git("worktree", "remove", "--force", str(TREE))


def ended(words, limit_s):
    """Status and text of a command, which with all that it started is over after its limit (status None)."""
    environment = {"CARGO_TARGET_DIR": str(WORK / "target")} | os.environ
    child = subprocess.Popen(
        words, cwd=TREE, env=environment, start_new_session=True,
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, errors="replace",
    )
    try:
        text, _ = child.communicate(timeout=limit_s)
        return child.returncode, text
    except subprocess.TimeoutExpired:
        os.killpg(child.pid, signal.SIGKILL)
        return None, child.communicate()[0]
    except BaseException:
        os.killpg(child.pid, signal.SIGKILL)
        raise


def split(command):
    words = command.split()
    end = words.index("--") if "--" in words else len(words)
    return ["cargo", "test", "--locked", *words[:end]], words[end:]


def tested(stage):
    """`passed`, or how a stage failed."""
    build, rest = split(stage["command"])
    status, text = ended([*build, "--no-run"], BUILD_S_MAX)
    if status != 0:
        errors = [line for line in text.splitlines() if line.startswith("error")]
        return "does not compile: " + (errors or ["no end to it"])[0]
    status, text = ended([*build, *rest], stage["limit_s"])
    if status is None:
        return f"longer than {stage['limit_s']} s"
    failed = re.findall(r"^test (\S+) \.\.\. FAILED", text, re.MULTILINE)
    return "passed" if status == 0 else ", ".join(failed[:3]) or "failed without a test's name"


def stages_of(name, rooms):
    room = max((room for room in rooms if name.startswith(room["folder"])), key=lambda room: len(room["folder"]))
    return room["stages"]


def write_changed(path, number, replacement):
    """Writes another line, indented as the old one."""
    lines = path.read_text().splitlines(keepends=True)
    indent = lines[number][: len(lines[number]) - len(lines[number].lstrip())]
    lines[number] = indent + replacement + "\n"
    path.write_text("".join(lines))


def outcome(place, at, stages, sound):
    """`caught`, `survived` or `void` of a place, and by what."""
    name, number = at
    path = TREE / name
    text = path.read_text()
    for stage in stages:
        if stage["command"] not in sound:
            sound[stage["command"]] = tested(stage)
        if sound[stage["command"]] != "passed":
            return "void", f"`{stage['command']}` without a change: {sound[stage['command']]}"
        try:
            write_changed(path, number, place["replace"])
            found = tested(stage)
        finally:
            path.write_text(text)
        if found.startswith("does not compile"):
            return "void", found
        if found != "passed":
            return "caught", found
    return "survived", ""


def run(options, listed):
    numbered = list(enumerate(listed["place"], 1))
    chosen = [pair for pair in numbered if not options.only or pair[0] in options.only]
    counts = dict.fromkeys(["caught", "survived", "gone", "void"], 0)
    sound = {}
    print("| place | line | change | seconds | outcome | by |\n| --- | --- | --- | --- | --- | --- |")
    make_tree()
    try:
        files = dict(product_files(TREE))
        for number, place in chosen:
            begun = time.monotonic()
            at = located(place, files)
            what, by = ("gone", "") if at is None else outcome(
                place, at, stages_of(place["file"], listed["room"])[: options.stages], sound
            )
            counts[what] += 1
            where = place["file"] if at is None else f"{at[0]}:{at[1] + 1}"
            line = place["replace"].replace("|", "\\|")
            cells = [str(number), where, f"{place['kind']}: `{line}`", f"{time.monotonic() - begun:.0f}", what, by]
            print("| " + " | ".join(cells) + " |", flush=True)
    finally:
        remove_tree()
    print("\n" + ", ".join(f"{count} {what}" for what, count in counts.items()))


def check(places):
    """Says which places are gone, and what a compiler says of all the others at once."""
    make_tree()
    try:
        files = dict(product_files(TREE))
        at = [located(place, files) for place in places]
        for place in (place for place, found in zip(places, at) if found is None):
            print(f"gone: {place['file']}: {place['find']}")
        for place, (name, number) in ((place, found) for place, found in zip(places, at) if found):
            write_changed(TREE / name, number, place["replace"])
        status, text = ended(["cargo", "check", "--locked", "--workspace"], BUILD_S_MAX)
        print(text if status else f"{len(places) - at.count(None)} places compile")
    finally:
        remove_tree()
    sys.exit(bool(status) or None in at)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("mode", choices=["run", "check", "draw"])
    parser.add_argument("--only", type=int, action="append", help="number of a place, from 1 on")
    parser.add_argument("--stages", type=int, help="at most so many commands for each place")
    options = parser.parse_args()
    os.chdir(ROOT)
    listed = tomllib.loads(LIST.read_text())
    if options.mode == "check":
        check(listed["place"])
    if options.mode == "run":
        run(options, listed)
        return
    for place in draw(listed["seed"]):
        print("\n[[place]]")
        for key, value in place.items():
            print(f"{key} = '''{value}'''" if "'" in value else f"{key} = '{value}'")


if __name__ == "__main__":
    main()
