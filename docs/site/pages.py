"""The pages of the documentation site that are made from the code: the help of the commands and the reference.

MkDocs loads this file as a hook. It adds pages to the navigation that mkdocs.yml states, and the project files that
live beside README.md, so that every text is written once.
"""

from __future__ import annotations

import ast
import os
import re
import subprocess
import sys
import textwrap
from pathlib import Path
from typing import Any

from mkdocs.plugins import get_plugin_logger
from mkdocs.structure.files import File

ROOT = Path(__file__).resolve().parents[2]
PACKAGE = "tdcr_planner"
PROJECT_FILES = {"contributing.md": "CONTRIBUTING.md", "changelog.md": "CHANGELOG.md"}
HELP_COLUMNS = 78
LIST_IN_PARAGRAPH = re.compile(r"^[^\s|#>*\d-][^\n]*\n[-*] ", re.MULTILINE)
FENCED = re.compile(r"^```.*?^```", re.MULTILINE | re.DOTALL)

logger = get_plugin_logger("pages")


def on_config(config: Any) -> Any:
    """Appends one reference page a package to the navigation's last section."""
    section = next(entry for entry in config.nav if "Reference" in entry)["Reference"]
    section.extend({title: path} for title, path, _ in _reference_pages())
    return config


def on_files(files: Any, config: Any) -> Any:
    """Adds the pages that have no file in docs/."""
    for path, source in PROJECT_FILES.items():
        text = (ROOT / source).read_text(encoding="utf-8").replace("](docs/", "](")
        files.append(File.generated(config, path, content=text))
    files.append(File.generated(config, "reference/commands.md", content=_commands_page()))
    for title, path, modules in _reference_pages():
        body = "\n\n".join(f"::: {module}" for module in modules)
        files.append(File.generated(config, path, content=f"# {title}\n\n{body}\n"))
    return files


def on_page_markdown(markdown: str, page: Any, **_: Any) -> None:
    """Warns of a list that the site would show as running text; GitHub shows a list."""
    for found in LIST_IN_PARAGRAPH.finditer(FENCED.sub("", markdown)):
        logger.warning("%s: a list needs an empty line before it: %r", page.file.src_uri, found[0][:60])


def _reference_pages() -> list[tuple[str, str, list[str]]]:
    """Title, path and modules of each reference page: one a package, and one for the modules beside the packages."""
    pages = []
    folder = ROOT / PACKAGE
    loose = [f"{PACKAGE}.{path.stem}" for path in sorted(folder.glob("*.py")) if _has_public_names(path)]
    for package in sorted(path for path in folder.iterdir() if (path / "__init__.py").is_file()):
        files = sorted(path for path in package.rglob("*.py") if _has_public_names(path))
        modules = [".".join(path.relative_to(ROOT).with_suffix("").parts) for path in files]
        if modules and package.name != "cli":
            pages.append((f"{PACKAGE}.{package.name}", f"reference/{package.name}.md", modules))
    return [*pages, (f"{PACKAGE}: single modules", "reference/modules.md", loose)]


def _has_public_names(path: Path) -> bool:
    if path.stem.startswith("_"):
        return False
    body = ast.parse(path.read_text(encoding="utf-8")).body
    kinds = (ast.FunctionDef, ast.ClassDef)
    return any(isinstance(node, kinds) and not node.name.startswith("_") for node in body)


def _commands_page() -> str:
    """The help text of every command, as `tdcr COMMAND --help` prints it."""
    names = _output(f"from {PACKAGE}.cli.commands import COMMANDS; print(*COMMANDS)", []).split()
    parts = ["# Commands\n\nEvery command prints this text for `--help`.\n"]
    parts += [f"## tdcr {name}\n\n```text\n{_help_text([name])}\n```\n" for name in names]
    return "\n".join(parts)


def _help_text(arguments: list[str]) -> str:
    text = _output(f"from {PACKAGE}.cli.main import main; main()", [*arguments, "--help"])
    return "\n".join(part for line in text.splitlines() for part in textwrap.wrap(line, HELP_COLUMNS) or [""])


def _output(code: str, arguments: list[str]) -> str:
    """Returns what a process of its own prints: the site is built without this package's imports."""
    environment = {**os.environ, "COLUMNS": str(HELP_COLUMNS), "NO_COLOR": "1", "PYTHONPATH": str(ROOT)}
    command = [sys.executable, "-c", code, *arguments]
    return subprocess.run(command, env=environment, capture_output=True, text=True, check=True).stdout.strip()
