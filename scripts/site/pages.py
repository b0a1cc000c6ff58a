# SPDX-License-Identifier: Apache-2.0
"""The pages of the site, for MkDocs (its hooks): the Markdown of the repository under its own paths, a page for each
file that a link leads to, lists of folders, and the navigation."""

import os
import re
from pathlib import Path

import griffe
from markdown.extensions import Extension
from markdown.treeprocessors import Treeprocessor
from mkdocs.exceptions import PluginError
from mkdocs.structure.files import File, Files, InclusionLevel

ROOT = Path(__file__).resolve().parents[2]
LANGUAGES = {".hpp": "cpp", ".cpp": "cpp", ".cuh": "cpp", ".cu": "cpp", ".h": "cpp", ".py": "python", ".sh": "bash",
             ".json": "json", ".txt": "cmake", ".cmake": "cmake"}
# Pages in docs/ that are not about the use of gsh. All others are guides, in the order of docs/README.md.
DEVELOPMENT = ["architecture", "conventions", "contributing", "testing", "robustness", "dependencies", "versions"]
MODULES = ["gsh", "gsh.torch"]  # whose public names the page of the Python API must have
ATTRIBUTES = ["__version__", "instruction_set"]  # which have no docstring; the page describes them
PYTHON = ["python", "python-torch", "from-gsplat", "python-api"]

_shown = {}  # path in the repository -> path of its page, for files and folders that are no Markdown
_page = None  # the page that is being rendered


def _repository_pages():
    names = ["README.md", "CHANGELOG.md", "SECURITY.md", "examples/README.md", "findings/README.md"]
    return names + sorted(str(p.relative_to(ROOT)) for p in (ROOT / "docs").rglob("*.md"))


def _title(page):
    return re.search(r"^# (.*)$", (ROOT / page).read_text(), re.MULTILINE)[1]


def _target(page, link):
    """The path in the repository that a relative link leads to, or None."""
    link = link.split("#")[0]
    if not link or ":" in link or link.startswith("/"):
        return None
    path = os.path.normpath(os.path.join(os.path.dirname(page), link))
    return None if path.startswith("..") else path


def _linked_paths(pages):
    for page in pages:
        for link in re.findall(r"\]\(([^)\s]*)\)", (ROOT / page).read_text()):
            path = _target(page, link)
            if path and not path.endswith(".md"):
                yield path


def _floors():
    """Folders of include/gsh, from the lowest floor up: [(floor, [folder, ...]), ...]."""
    text = (ROOT / "docs/architecture.md").read_text()
    rows = re.findall(r"^\| (\d+) \| (`[^|]*) \|", text, re.MULTILINE)
    return [(int(floor), re.findall(r"`(\w+)`", folders)) for floor, folders in rows]


def _components():
    """The pages of components by floor: [("Floor 1: math, backend", [page, ...]), ...]. A page belongs to the folder of
    the first header or folder that it names."""
    floors, pages = _floors(), {}
    known = [folder for _, folders in floors for folder in folders]
    path = re.compile(r"`(?:gsh/)?(%s)/" % "|".join(known))
    for file in sorted((ROOT / "docs/components").glob("*.md")):
        found = path.search(file.read_text())
        if not found:
            raise ValueError(f"docs/components/{file.name} names no header, expected one such as `math/sh.hpp`")
        pages.setdefault(found[1], []).append(f"docs/components/{file.name}")
    groups = []
    for floor, folders in floors:
        there = [folder for folder in folders if folder in pages]
        if there:
            groups.append((f"Floor {floor}: {', '.join(there)}", [p for folder in there for p in pages[folder]]))
    return groups


def _navigation():
    def docs(names):
        return [f"docs/{name}.md" for name in names if (ROOT / f"docs/{name}.md").exists()]

    index = (ROOT / "docs/README.md").read_text()
    mentioned = list(dict.fromkeys(re.findall(r"\]\(([\w-]+)\.md", index)))
    guides = [name for name in mentioned if name not in DEVELOPMENT + PYTHON + ["gallery"]]
    return [
        {"gsh": ["README.md"] + docs(["gallery"])},
        {"Guides": ["docs/README.md"] + docs(guides)},
        {"Python": docs(PYTHON)},
        {"Components": ["docs/components/index.md"] + [{name: pages} for name, pages in _components()]},
        {"Notes": [f"docs/notes/{file.name}" for file in sorted((ROOT / "docs/notes").glob("*.md"))]},
        {"Development": docs(DEVELOPMENT) + ["examples/README.md", "findings/README.md", "SECURITY.md", "CHANGELOG.md"]},
    ]


def _components_index():
    lines = ["# Components", "", "Floors are those of [the architecture](../architecture.md), from the lowest up."]
    for name, pages in _components():
        lines += ["", f"## {name}", ""]
        lines += [f"- [{_title(page)}]({os.path.basename(page)})" for page in pages]
    return "\n".join(lines) + "\n"


def _folder_list(folder):
    files = sorted(p.relative_to(ROOT / folder) for p in (ROOT / folder).rglob("*") if p.is_file())
    lines = [f"# {folder}", ""]
    for file in files:
        linked = f"{folder}/{file}" in _shown
        lines.append(f"- [`{file}`]({file}.md)" if linked else f"- `{file}`")
    return "\n".join(lines) + "\n"


def _file_text(path):
    text = (ROOT / path).read_text()
    fence = "`" * max([3] + [len(run) + 1 for run in re.findall(r"^`{3,}", text, re.MULTILINE)])
    return f"# {os.path.basename(path)}\n\n`{path}` in the repository:\n\n" \
           f"{fence}{LANGUAGES.get(Path(path).suffix, 'text')}\n{text.rstrip()}\n{fence}\n"


class _Links(Treeprocessor):
    """Links to files and folders of the repository lead to the pages that show them."""

    def run(self, root):
        for link in root.iter("a"):
            path = _target(_page, link.get("href", "")) if _page else None
            if path in _shown:
                link.set("href", os.path.relpath(_shown[path], os.path.dirname(_page) or "."))


class _LinksExtension(Extension):
    def extendMarkdown(self, md):  # after links are parsed (20), before MkDocs checks them (0)
        md.treeprocessors.register(_Links(md), "gsh_links", 5)


def on_config(config):
    config.markdown_extensions.append(_LinksExtension())
    return config


def on_files(files, config):
    pages = _repository_pages()

    def of_repository(path, inclusion=InclusionLevel.UNDEFINED):
        return File(path, str(ROOT), config.site_dir, config.use_directory_urls, inclusion=inclusion)

    def generated(path, text, inclusion=InclusionLevel.UNDEFINED):
        return File.generated(config, path, content=text, inclusion=inclusion)

    site = Files([file for file in files if not file.is_documentation_page()] + [of_repository(page) for page in pages])
    for image in sorted((ROOT / "docs/images").iterdir()):
        site.append(of_repository(f"docs/images/{image.name}"))

    _shown.clear()
    for path in sorted(set(_linked_paths(pages))):
        if (ROOT / path / "README.md").exists():
            _shown[path] = f"{path}/README.md"
        elif (ROOT / path).is_dir():
            _shown[path] = f"{path}/index.md"
        elif (ROOT / path).is_file() and not path.startswith("docs/images/"):
            _shown[path] = f"{path}.md"
    for path, page in _shown.items():
        if page.endswith("/README.md"):
            continue
        if path == "docs/components":
            site.append(generated(page, _components_index()))
        else:
            text = _folder_list(path) if (ROOT / path).is_dir() else _file_text(path)
            # Files can be found from the pages that link to them. In the search they would hide the pages.
            site.append(generated(page, "---\nsearch: {exclude: true}\n---\n" + text, InclusionLevel.NOT_IN_NAV))
    config.nav = _navigation()
    return site


def on_page_markdown(markdown, page, config, files):
    global _page
    _page = page.file.src_uri
    return markdown


def on_page_content(html, page, config, files):
    """Fails for a name of the Python package that has no docstring, and would be missing on its page."""
    if page.file.src_uri == "docs/python-api.md":
        for name in MODULES:
            module = griffe.load(name, search_paths=[ROOT / "python"], allow_inspection=False)
            exports = [str(export) for export in module.exports or []]
            if not exports:
                raise PluginError(f"{name}: __all__ could not be read, expected a list of strings")
            for export in exports:
                if export not in ATTRIBUTES and f'id="{name}.{export}"' not in html:
                    raise PluginError(f"{name}.{export} is not on the page of the Python API; has it a docstring?")
    return html
