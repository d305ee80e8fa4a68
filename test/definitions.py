"""Md5 sums of message definitions, computed from their files: nothing is built.

A publisher and a subscriber understand each other exactly when the md5 sums of their
types agree.
"""

from pathlib import Path

import genmsg
import genmsg.gentools
import genmsg.msg_loader
import rospkg

REPOSITORY = Path(__file__).resolve().parents[1]
DESIGN = REPOSITORY.parent / "shared" / "design"


def message_folders(package):
    """Find the definitions of a package, also where only those are installed."""
    packages = rospkg.RosPack()
    roots = [Path(root) / package for root in packages.get_ros_paths()]
    if package in packages.list():
        roots.insert(0, Path(packages.get_path(package)))
    return [str(root / "msg") for root in roots if (root / "msg").is_dir()]


class Definitions:
    """The definitions of a package in interfaces/."""

    def __init__(self, package, dependencies):
        self.package = package
        self.folder = REPOSITORY / "interfaces" / package
        paths = {name: message_folders(name) for name in dependencies}
        self._search_path = {package: [str(self.folder / "msg")], **paths}

    def md5_of_text(self, kind, name, text):
        """Compute the sum of a message or service.

        Args:
            kind: What it is, msg or srv.
            name: Its name.
            text: Its definition.
        """
        context = genmsg.MsgContext.create_default()
        load = getattr(genmsg.msg_loader, f"load_{kind}_from_string")
        spec = load(context, text, f"{self.package}/{name}")
        genmsg.msg_loader.load_depends(context, spec, self._search_path)
        return genmsg.gentools.compute_md5(context, spec)

    def md5_of_file(self, kind, name):
        """Compute the sum of a message or service from its file."""
        text = (self.folder / kind / f"{name}.{kind}").read_text(encoding="utf-8")
        return self.md5_of_text(kind, name, text)
