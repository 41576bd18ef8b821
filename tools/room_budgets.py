"""What each room weighs, against the budgets in tools/budgets.toml: tools/rooms.py --budget [--lower | --write]

In: the files of a checkout that git knows or would add, and the tree of packages that cargo finds. Out: a row for each
room, and exit 1 if a figure is above its budget. A figure that is 2 % or 100 below its budget is named, since the
budget can go down with it; `--lower` writes such budgets down, never up; `--write` sets every budget to its figure.

Rules of the count:
- A room of lines is a path in budgets.toml with all that lies below it, but for what a longer path there holds; `rest` is
  what no path holds.
- Product: the Rust of protocol/, firmware/ and host/, comments and blank lines included, without files of tests (`tests/`,
  `*tests.rs`, `test_*.rs`) and without items marked `#[cfg(test)]`. Tests: these items, and all other Rust.
- Some files name their tests at the head; a count that ends at the first `#[cfg(test)]` of a file, as some did, misses
  what follows there. Its sum is printed too, to compare with them.
- Lines count as rustfmt lays them out with its default settings, whatever a configuration asks; `rustfmt::skip` is refused.
- Words: those of all Markdown but CHANGELOG.md, divided at white space as `wc -w` does.
- Fitted constants: those in the tables of docs/design/planner-constants.md, which a test compares with the sources.
- Packages: different ones in `cargo tree -p headway -e normal`, our own included, with and without default features.
"""

import re
import subprocess
import sys
import tempfile
import tomllib
from collections import defaultdict
from pathlib import Path

BUDGETS = Path("tools/budgets.toml")
PRODUCT = ("protocol/", "firmware/", "host/")
CONSTANTS = Path("docs/design/planner-constants.md")
PLANNER = ("host/src/plan", "host/plan", "host/optimiser", "host/geometry", "host/reach")
# What opens or ends an item, and texts in which such a sign means nothing.
TOKEN = re.compile(
    r"""//[^\n]*|/\*.*?\*/|\bb?r(?P<hashes>\#*)".*?"(?P=hashes)|"(?:\\.|[^"\\])*"|'(?:\\.[^']*|[^'\\])'|[(){}\[\];]""",
    re.DOTALL,
)


class Refused(Exception):
    """Why nothing can be counted."""


def run(*command, **options):
    try:
        return subprocess.run(command, capture_output=True, text=True, **options)
    except FileNotFoundError as missing:
        raise Refused(f"{missing.filename} is not installed") from missing


def listed_files():
    listed = run("git", "ls-files", "--cached", "--others", "--exclude-standard")
    if listed.returncode != 0:
        raise Refused(listed.stderr.strip())
    return sorted(path for path in map(Path, listed.stdout.splitlines()) if path.is_file())


def is_root(path):
    """Whether a program or a crate begins here, so that rustfmt finds its modules by itself."""
    return path.name in ("lib.rs", "main.rs", "build.rs") or path.parent.name in (
        "bin", "examples", "benches", "fuzz_targets", "tests",
    )


def default_layouts(sources):
    """The text of every source as rustfmt's default settings lay it out."""
    with tempfile.NamedTemporaryFile(suffix=".toml") as empty:
        format_ = ["rustfmt", "--edition", "2024", "--config-path", empty.name]
        reached, changed = set(), set()
        for files in ([path for path in sources if is_root(path)], None):
            files = files or [path for path in sources if path.resolve() not in reached]
            if not files:
                continue
            done = run(*format_, "--check", "--files-with-diff", "--verbose", *files)
            if done.stderr:
                raise Refused(done.stderr.strip())
            for line in done.stdout.splitlines():
                if line.startswith("Formatting "):
                    reached.add(Path(line.removeprefix("Formatting ")).resolve())
                elif line.startswith("/"):
                    changed.add(Path(line).resolve())
        layouts = {}
        for path in sources:
            text = path.read_text()
            if "rustfmt::skip" in text:
                raise Refused(f"{path}: rustfmt::skip hides lines from the count; remove it")
            if path.resolve() in changed:
                text = run(*format_, "--emit", "stdout", input=text, check=True).stdout
            layouts[path] = text
    return layouts


def end_of_item(text, begin):
    """Where the item ends that begins here: behind its semicolon or its closing brace."""
    depth = 0
    for token in TOKEN.finditer(text, begin):
        sign = token.group()
        depth += (sign in ("(", "[", "{")) - (sign in (")", "]", "}"))
        if depth == 0 and sign in (";", "}"):
            return token.end()
    return len(text)


def items_of_tests(text):
    """Where items marked `#[cfg(test)]` begin and end."""
    end = 0
    for mark in re.finditer(r"^ *#\[cfg\(test\)\]", text, re.MULTILINE):
        if mark.start() >= end:
            end = end_of_item(text, mark.start())
            yield mark.start(), end


def lines_of_tests(text):
    return sum(text.count("\n", begin, end) + 1 for begin, end in items_of_tests(text))


def room_of(path, rooms):
    held = [room for room in rooms if path == room or path.startswith(room + "/")]
    return max(held, key=len, default="rest")


def counted_lines(files, budgets, is_test):
    product, tests, before_tests = defaultdict(int), defaultdict(int), 0
    for path, text in default_layouts([path for path in files if path.suffix == ".rs"]).items():
        name, lines = str(path), len(text.splitlines())
        of_tests = lines
        if name.startswith(PRODUCT) and not is_test(path):
            of_tests = lines_of_tests(text)
            product[room_of(name, budgets["product_lines"])] += lines - of_tests
            before_tests += len(re.split(r"^#\[cfg\(test\)\]", text, maxsplit=1, flags=re.MULTILINE)[0].splitlines())
        tests[room_of(name, budgets["test_lines"])] += of_tests
    return product, tests, before_tests


def counted_words(files, budgets):
    words = defaultdict(int)
    for path in files:
        if path.suffix == ".md" and path.name != "CHANGELOG.md":
            words[room_of(str(path), budgets["words"])] += len(path.read_text().split())
    return words


def fitted_constants():
    table = CONSTANTS.read_text().partition("\n## Fitted\n")[2].partition("\n## ")[0]
    return sum(line.count("`: ") for line in table.splitlines() if line.startswith("| `"))


def packages(*options):
    tree = run("cargo", "tree", "--locked", "-p", "headway", "-e", "normal", "--prefix", "none", *options)
    if tree.returncode != 0:
        raise Refused(tree.stderr.strip())
    return len({line.removesuffix(" (*)") for line in tree.stdout.splitlines()})


def figures(budgets, is_test):
    files = listed_files()
    product, tests, before_tests = counted_lines(files, budgets, is_test)
    whole = {
        "fitted_constants": fitted_constants(),
        "packages": packages(),
        "packages_without_default_features": packages("--no-default-features"),
    }
    words = counted_words(files, budgets)
    return {"product_lines": product, "test_lines": tests, "words": words, "whole": whole}, before_tests


def rewritten(text, table, room, figure):
    """The file of budgets with one of them set; a room that the table lacks is added at its head."""
    key = rf'(?:"{re.escape(room)}"|{re.escape(room)})'
    head, mark, rest = text.partition(f"[{table}]\n")
    own, next_mark, after = rest.partition("\n[")
    own, changed = re.subn(rf"^({key} = )\d+", rf"\g<1>{figure}", own, count=1, flags=re.MULTILINE)
    if not changed:
        own = f'"{room}" = {figure}\n' + own
    return head + mark + own + next_mark + after


def main(is_test, lower, write):
    """Prints the figures beside their budgets; returns the status to exit with."""
    try:
        return check(is_test, lower, write)
    except Refused as why:
        print(why, file=sys.stderr)
        return 2


def check(is_test, lower, write):
    text = BUDGETS.read_text()
    budgets = tomllib.loads(text)
    over = []
    counted, before_tests = figures(budgets, is_test)
    for table, found in counted.items():
        for room in sorted(set(budgets[table]) | set(found)):
            figure, budget = found.get(room, 0), budgets[table].get(room, 0)
            note = ""
            if figure > budget:
                note = f"over its budget by {figure - budget}"
                over.append(f"{table}: {room}: {figure}, budget {budget}, over by {figure - budget}")
            elif budget - figure >= max(1, min(budget // 50, 100)):
                note = "the budget can go down" if figure else "nothing is here: the budget can go"
                text = rewritten(text, table, room, figure)
            if write and figure != budget:
                text = rewritten(text, table, room, figure)
            print(f"{figure:7} of {budget:6}  {table}: {room}  {note}".rstrip())
    product = counted["product_lines"]
    planner = sum(lines for room, lines in product.items() if room.startswith(PLANNER))
    for name, figure in [
        ("product lines", sum(product.values())),
        ("of them before the first #[cfg(test)] of their file", before_tests),
        ("plan, optimiser, geometry and reach", planner),
        ("test lines", sum(counted["test_lines"].values())),
        ("words", sum(counted["words"].values())),
    ]:
        print(f"{figure:7}  {name}")
    if lower or write:
        BUDGETS.write_text(text)
    for line in over:
        print(line, file=sys.stderr)
    return 1 if over and not write else 0
