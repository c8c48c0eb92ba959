"""The documentation as a site: it builds, its links lead somewhere, it names files that exist."""

from __future__ import annotations

import ast
import itertools
import re
import shutil
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest

from swarm_ctl.study.rows import COLUMNS
from tests.unit.docs.pages import DOCS, DOCUMENTS, ROOT, blocks, prose

README_WORDS = 900
PICTURE_BYTES = 1_000_000
LINK = re.compile(r"\[[^\]]*\]\(([^)\s]+)\)")
OWN_PATH = re.compile(r"`((?:swarm_ctl|sim|tests|missions|studies|docs|docker)/[\w./*-]+)`")
CITED = re.compile(r"docs/([\w/-]+)\.md(?:#([\w-]+))?")


def identify(path: Path) -> str:
    return str(path.relative_to(ROOT))


FILES = (file for top in ("swarm_ctl", "sim", "tests") for file in (ROOT / top).rglob("*.py"))
CODE = "\n".join((*(file.read_text() for file in FILES), *COLUMNS))
documents = pytest.mark.parametrize("document", DOCUMENTS, ids=identify)


def anchors(document: Path) -> set[str]:
    """The anchors of a page's headings, as GitHub and mkdocs make them."""
    headings = re.findall(r"^#+ (.+)$", prose(document), re.MULTILINE)
    plain = [re.sub(r"[^\w\s-]", "", heading).strip().lower() for heading in headings]
    return {re.sub(r"\s+", "-", heading) for heading in plain}


@documents
def test_links_lead_to_files_and_headings_that_exist(document: Path) -> None:
    wrong = []
    for target in LINK.findall(prose(document)):
        if target.startswith(("https://", "http://")):
            continue
        path, _, anchor = target.partition("#")
        file = (document.parent / path).resolve() if path else document
        if not file.exists() or (anchor and file.suffix == ".md" and anchor not in anchors(file)):
            wrong.append(target)
    assert wrong == []


@documents
def test_files_in_backticks_exist(document: Path) -> None:
    named = OWN_PATH.findall(document.read_text())
    assert [path for path in named if not list(ROOT.glob(path.rstrip("/")))] == []


@documents
def test_modules_that_commands_name_exist(document: Path) -> None:
    """`python -m tests.bench.bench_run` and the like."""
    for name in re.findall(r"python -m ((?:swarm_ctl|sim|tests)[\w.]*)", document.read_text()):
        path = ROOT.joinpath(*name.split("."))
        assert path.with_suffix(".py").exists() or (path / "__main__.py").exists(), name


CLUSTERS = ("dask_jobqueue", "dask_kubernetes")


@documents
def test_python_blocks_import_what_exists(document: Path) -> None:
    """Of this project and what it installs; a cluster's own libraries are its owner's."""
    for block in blocks(document):
        if block.language == "python":
            for node in ast.walk(ast.parse(block.text)):
                if isinstance(node, ast.ImportFrom) and node.module:
                    if node.module.partition(".")[0] in CLUSTERS:
                        continue
                    module = import_module(node.module)
                    assert [n.name for n in node.names if not hasattr(module, n.name)] == []


def test_the_code_cites_pages_and_sections_that_exist() -> None:
    wrong = []
    for top in ("swarm_ctl", "sim", "tests"):
        for file in (ROOT / top).rglob("*.py"):
            for page, anchor in CITED.findall(file.read_text()):
                path = DOCS / f"{page}.md"
                if not path.exists() or (anchor and anchor not in anchors(path)):
                    wrong.append(f"{identify(file)}: {page}.md#{anchor}")
    assert wrong == []


@documents
def test_identifiers_in_backticks_are_in_the_code(document: Path) -> None:
    """`adapt_sigma`, `Phase.HOLD` and the like; plain words are not looked up."""
    names = itertools.chain.from_iterable(
        re.findall(r"`(\w+)(?:\.(\w+))?(?:\(\))?`", prose(document))
    )
    code = [
        name
        for name in names
        if "_" in name or re.search(r"[a-z][A-Z]|^[A-Z][a-z]+$|^[A-Z]{2}", name)
    ]
    assert [name for name in code if name not in CODE] == []


def test_documents_named_in_capitals_exist() -> None:
    """README.md and its like, in code and in documents."""
    there = {path.name for path in DOCUMENTS}
    files = [file for top in ("swarm_ctl", "sim", "tests") for file in (ROOT / top).rglob("*.py")]
    wrong = [
        f"{identify(file)}: {name}"
        for file in (*files, *DOCUMENTS)
        for name in re.findall(r"\b[A-Z]{3,}\.md\b", file.read_text())
        if name not in there
    ]
    assert wrong == []


def test_the_code_names_modules_that_exist() -> None:
    """`core/kernel/response.py` and other paths in backticks, from any folder above or `tests/`."""
    files = [file for top in ("swarm_ctl", "sim", "tests") for file in (ROOT / top).rglob("*.py")]
    wrong = [
        f"{identify(file)}: {path}"
        for file in files
        for path in re.findall(r"`([\w/]+/\w+\.(?:py|md|yaml))`", file.read_text())
        if not any((root / path).exists() for root in (*file.parents, ROOT / "swarm_ctl"))
    ]
    assert wrong == []


def test_the_readme_is_short() -> None:
    assert len((ROOT / "README.md").read_text().split()) <= README_WORDS


def test_pictures_are_small() -> None:
    for picture in DOCS.rglob("*.svg"):
        assert picture.stat().st_size < PICTURE_BYTES


@pytest.mark.timeout(120)
def test_the_site_builds_without_warnings_and_needs_no_other_host(tmp_path: Path) -> None:
    command = ["-m", "mkdocs", "build", "--strict", "-q", "-f", str(ROOT / "mkdocs.yml")]
    built = subprocess.run(
        [sys.executable, "-W", "ignore", *command, "-d", str(tmp_path)],
        capture_output=True,
        text=True,
        check=False,
    )
    assert built.returncode == 0, built.stdout + built.stderr
    for page in tmp_path.rglob("*.html"):
        loaded = re.findall(
            r'<(?:script|img|link)[^>]*(?:src|href)="(https?://[^"]+)"', page.read_text()
        )
        assert [host for host in loaded if "canonical" not in host] == []


def test_zensical_builds_the_site_without_warnings(tmp_path: Path) -> None:
    """mkdocs-material's successor reads the same mkdocs.yml."""
    pytest.importorskip("zensical", reason="pip install '.[docs]'")
    shutil.copytree(DOCS, tmp_path / "docs")
    shutil.copy(ROOT / "mkdocs.yml", tmp_path)
    command = [sys.executable, "-m", "zensical", "build", "--strict"]
    built = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert built.returncode == 0, built.stdout + built.stderr
    assert (tmp_path / "build/site/do/safety/index.html").exists()
