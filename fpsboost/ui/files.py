"""Files of this machine as the page lists them, and the access that the page has to them."""

import os
import stat
import subprocess
import sys
from dataclasses import dataclass, field
from mimetypes import guess_type
from pathlib import Path
from typing import Any

from fpsboost import InputError, OutputError
from fpsboost.extension import IMAGE_SUFFIXES, OUTPUT_SUFFIXES, UnfinishedOutput, explained, stands_for_images

MAX_ENTRIES = 2000
"""Maximum number of folders and clips that are listed from a folder."""


@dataclass
class Files:
    """The part of the file system that the page may use: the content of the root, or everything if that is None.

    A page in a browser is a way in for other programs and pages. What it may read must be picked first, lie inside of
    the root when all links are followed, and stay there.
    """

    root: Path | None = None
    """Folder that the page may use; None for all of the file system."""
    _picked: set[Path] = field(default_factory=set)  # paths are only added and looked up, which needs no lock

    def inside(self, text: str) -> Path:
        """Return a path with all symbolic links followed; raises `InputError` if it is outside of the root."""
        if not text or "\0" in text:
            raise InputError("The name of the input is empty; name a video or a folder of images.")
        path = Path(os.path.realpath(os.path.expanduser(text)))
        if not self._is_inside(path):
            raise InputError(f"{text} lies outside of {self.root}, to which this page is restricted.")
        return path

    def listing(self, text: str) -> dict[str, Any]:
        """Return the folders and clips in a folder, and the folders above it, as plain data."""
        folder = self.inside(text)
        with explained(InputError, "list", str(folder), "check the permissions"):
            content = sorted(os.scandir(folder), key=lambda each: each.name.casefold())
        entries = list[dict[str, Any]]()
        images = 0
        for each in content:
            if each.name.startswith("."):
                continue
            kind, size = ("other", 0) if self._leads_out(each) else _kind(each)
            images += kind == "image"
            if kind in ("folder", "clip"):
                entries.append({"name": each.name, "path": str(folder / each.name), "kind": kind, "size": size})
        entries.sort(key=lambda each: each["kind"] == "clip")
        above = [
            each for each in (*reversed(folder.parents), folder) if self.root is None or each.is_relative_to(self.root)
        ]
        return {
            "path": str(folder),
            "above": [{"name": each.name or each.anchor, "path": str(each)} for each in above],
            "entries": entries[:MAX_ENTRIES],
            "left_out": max(0, len(entries) - MAX_ENTRIES),
            "images": images,
        }

    def find(self, wanted: list[dict[str, Any]], start: str) -> dict[str, list[str]]:
        """Return the paths of files by name and size, and the missing names of those that are not near a folder.

        A browser does not give the path of a file that is dropped on the page. It is searched for in the folder, in the
        root or the home folder, and in the folders there.
        """
        home = self.root or Path.home()
        folders = [self.inside(start), home, *(each for each in sorted(home.iterdir()) if each.name[0] != ".")]
        paths = list[str]()
        missing = list[str]()
        for each in wanted:
            name = Path(str(each.get("name"))).name
            places = (folder / name for folder in folders if self._is_inside(folder / name))
            files = (path for path in places if os.path.isfile(path))  # unlike pathlib's, for impossible names, too
            found = next((path for path in files if path.stat().st_size == each.get("size")), None)
            (missing if found is None else paths).append(name if found is None else str(found))
        return {"paths": paths, "missing": missing}

    def pick(self, text: str) -> str:
        """Return the path of an input, which may be read from now on."""
        path = self.inside(text)
        if path.exists() and not (path.is_file() or path.is_dir()):
            raise InputError(f"{text} is neither a file nor a folder; name a video or a folder of images.")
        self._check_links(path)
        self._picked.add(path)
        return str(path)

    def check_picked(self, path: str) -> None:
        """Raise `InputError` unless a path was picked, and still is what it was then."""
        if Path(path) not in self._picked or self.inside(path) != Path(path):
            raise InputError(f"{path} was not picked on this page; pick it first.")
        self._check_links(Path(path))

    def check_job(self, input: str, output: str) -> None:
        """Raise `InputError` or `OutputError` if a conversion would read or write outside of the root."""
        if self.root is not None:
            self._check_links(self.inside(input))
            self.output(str(Path(output).parent), Path(output).name)

    def output(self, folder: str, name: str) -> str:
        """Return the path of an output by its folder and name, with a slash at the end for a folder of images.

        Raises `OutputError` if the name is not that of a file in this folder, or is a link.
        """
        place = self.inside(folder)
        file = name.rstrip("/\\")
        if not file or file in (".", "..") or file != Path(file).name or "\\" in file or "\0" in file:
            raise OutputError(f"{name!r} is not a file name; write one such as clip-2x.mp4, and pick its folder.")
        path = place / file
        if any(each.is_symlink() for each in (path, *UnfinishedOutput(path).places)):
            raise OutputError(f"{path} is a link to another place, or was begun there; choose another name.")
        return f"{path}/" if len(file) < len(name) else str(path)

    def _leads_out(self, entry: os.DirEntry[str]) -> bool:
        """Return whether an entry of a folder is a link to something outside of the root."""
        return entry.is_symlink() and not self._is_inside(entry.path)

    def _is_inside(self, path: str | Path) -> bool:
        """Return whether a path lies in the root when all links are followed."""
        return self.root is None or ("\0" not in str(path) and Path(os.path.realpath(path)).is_relative_to(self.root))

    def _check_links(self, path: Path) -> None:
        """Raise `InputError` if the images of an input, a folder or a pattern, are links to outside of the root."""
        folder = path if path.is_dir() else path.parent
        if self.root is None or not stands_for_images(str(path)) or not folder.is_dir():
            return
        with explained(InputError, "list", str(folder), "check the permissions"), os.scandir(folder) as entries:
            for each in entries:
                if self._leads_out(each):
                    raise InputError(f"{each.path} is a link to outside of {self.root}; remove it, or pick another.")


def show_in_folder(path: Path) -> None:
    """Show a file in the file manager of this machine, or its folder where nothing shows a file in it."""
    commands = {"win32": ["explorer", f"/select,{path}"], "darwin": ["open", "-R", str(path)]}
    words = commands.get(sys.platform, ["xdg-open", str(path.parent)])
    try:
        subprocess.Popen(words, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    except OSError as error:
        raise OutputError(f"{words[0]} could not be started to show the folder; the file is {path}.") from error


def _kind(entry: os.DirEntry[str]) -> tuple[str, int]:
    """Return the kind of an entry of a folder, and its size in bytes."""
    try:
        state = entry.stat()
    except OSError:  # a link that leads nowhere, or a file that has just gone
        return "other", 0
    if not stat.S_ISREG(state.st_mode):
        return ("folder" if stat.S_ISDIR(state.st_mode) else "other"), 0
    suffix = Path(entry.name).suffix.lower()
    if suffix in OUTPUT_SUFFIXES or (guess_type(entry.name)[0] or "").startswith("video/"):
        return "clip", state.st_size
    return ("image" if suffix in IMAGE_SUFFIXES else "other"), state.st_size
