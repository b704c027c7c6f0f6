"""README and docs: every Python block runs, every command exists with its options, and the test command is the one that CI runs."""

import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest
import typer.main

from seo_slam.cli.app import app

ROOT = Path(__file__).resolve().parents[1]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
FENCE = re.compile(r"^(?P<indent> *)```(?P<language>\w+)[^\n]*\n(?P<body>.*?)^(?P=indent)```\s*?$", re.DOTALL | re.MULTILINE)
NO_TEST = re.compile(r"<!-- no-test: \S.*-->\s*$")


def blocks(text, language):
    """Line number and source of each block of a language, but for those that a comment excuses with a reason."""
    for match in FENCE.finditer(text):
        if match["language"] == language and not NO_TEST.search(text[: match.start()]):
            body = re.sub(rf"^{match['indent']}", "", match["body"], flags=re.MULTILINE)
            yield text[: match.start()].count("\n") + 1, body


def blocks_of_all_pages(language):
    return [
        pytest.param(body, id=f"{page.relative_to(ROOT)}:{line}")
        for page in PAGES
        for line, body in blocks(page.read_text(encoding="utf-8"), language)
    ]


def commands(body):
    """The `seo-slam` commands of a shell block, as words; continued lines are joined, prompts and comments dropped."""
    for line in body.replace("\\\n", " ").splitlines():
        for part in re.split(r"&&|;|\|", line.strip().removeprefix("$ ")):
            words = shlex.split(part, comments=True)
            while words and re.fullmatch(r"[A-Z_]+=.*", words[0]):
                words = words[1:]
            if words and words[0].rpartition("/")[2] == "seo-slam":
                yield words[1:]


def complaint(words):
    """What is wrong with the words after `seo-slam`: a command or option that does not exist; "" if all is well."""
    command = typer.main.get_command(app)
    known = {}
    rest = list(words)
    while rest and hasattr(command, "commands") and not rest[0].startswith("-"):
        name = rest.pop(0)
        if name not in command.commands:
            return f"no command {name!r}; known: {', '.join(sorted(command.commands))}"
        command = command.commands[name]
    for parameter in command.params:
        known.update(dict.fromkeys([*parameter.opts, *parameter.secondary_opts], parameter))
    for word in rest:
        option = word.partition("=")[0]
        if re.fullmatch(r"-{1,2}[A-Za-z][\w-]*", option) and option not in known and option != "--help":
            return f"{command.name} has no option {option!r}; known: {', '.join(sorted(known))}"
    return ""


@pytest.mark.parametrize("body", blocks_of_all_pages("python"))
def test_python_blocks_run(body, tmp_path):
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", body],
        cwd=tmp_path,
        env={**os.environ, "MPLBACKEND": "Agg"},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("body", blocks_of_all_pages("bash"))
def test_commands_exist(body):
    assert [complaint(words) for words in commands(body)] == [""] * len(list(commands(body)))


def test_ci_runs_the_test_command_of_the_readme():
    last = (ROOT / ".ci" / "run").read_text(encoding="utf-8").strip().splitlines()[-1]
    shell = "\n".join(body for _, body in blocks((ROOT / "README.md").read_text(encoding="utf-8"), "bash"))
    assert last in shell.splitlines(), f"README.md has no bash block with the line {last!r}"


def test_every_page_is_in_the_navigation():
    listed = re.findall(r"[\w/-]+\.md", (ROOT / "mkdocs.yml").read_text(encoding="utf-8"))
    assert sorted(listed) == sorted(str(page.relative_to(ROOT / "docs")) for page in PAGES[1:])


def test_the_test_finds_blocks_and_commands():
    page = "\n".join(
        [
            "```python",
            "x = 1",
            "```",
            "<!-- no-test: takes minutes -->",
            "```python",
            "y",
            "```",
            "- a",
            "  ```bash",
            "  A=1 seo-slam query MAP 'a b' -k 3 && ls",
            "  ```",
        ]
    )
    assert list(blocks(page, "python")) == [(1, "x = 1\n")]
    ((_, body),) = blocks(page, "bash")
    assert list(commands(body)) == [["query", "MAP", "a b", "-k", "3"]]
    assert complaint(["query", "MAP", "a b", "-k", "3"]) == ""


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["quarry", "MAP"], "no command 'quarry'"),
        (["eval", "maps"], "no command 'maps'"),
        (["eval", "landmarks", "M", "T", "--radios", "0.2"], "no option '--radios'"),
        (["query", "M", "text", "-n=3"], "no option '-n'"),
    ],
)
def test_the_test_sees_mistakes(words, message):
    assert message in complaint(words)
