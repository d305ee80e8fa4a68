"""What a module may import, and how many there are in a folder, read from the source.

Layers say what may be imported, rooms (folders) what the code is about.
"""

from __future__ import annotations

import ast

PACKAGE = "g1_description"
GENERATED = ("msg", "srv")
MOST_IN_A_ROOM = 9


class Layers:
    """The modules of a source tree, and what they import."""

    def __init__(self, source):
        """Read all modules below a folder, which is the package's."""
        self.source = source
        self.paths = {
            ".".join(path.relative_to(source).with_suffix("").parts): path
            for path in sorted(source.rglob("*.py"))
            if path.name != "__init__.py"
        }
        self.imports = {name: [*self._imports(name)] for name in self.paths}

    def _imports(self, name):
        """List what a module imports: level, module, and names out of it.

        Those behind ``if TYPE_CHECKING`` count too.
        """
        text = self.paths[name].read_text(encoding="utf-8")
        for node in ast.walk(ast.parse(text, feature_version=(3, 8))):
            if isinstance(node, ast.Import):
                yield from ((0, alias.name, []) for alias in node.names)
            elif isinstance(node, ast.ImportFrom):
                names = [alias.name for alias in node.names]
                yield node.level, node.module or "", names

    def foreign(self, name):
        """Name the top-level packages of others that a module imports."""
        absolute = [module for level, module, _ in self.imports[name] if not level]
        return {module.split(".")[0] for module in absolute} - {PACKAGE}

    def own(self, name):
        """Name the modules of ours that a module imports."""
        found = set()
        for level, module, names in self.imports[name]:
            if level:
                room = name.split(".")[:-level]
                start = ".".join([*room, module] if module else room)
            elif module.split(".")[0] == PACKAGE:
                start = module[len(PACKAGE) + 1 :]
            else:
                continue
            if start in GENERATED:
                continue
            inside = {f"{start}.{other}" for other in names} & set(self.paths)
            found |= inside or {start}
        return found

    def of_layer(self, layer):
        """Name the modules of a layer, in whatever room."""
        return [name for name in self.paths if name.split(".")[0] == layer]

    def stretched(self):
        """Name the modules that import relatively from another room."""
        return [
            name
            for name in self.paths
            if any(
                level > 1 or "." in module
                for level, module, _ in self.imports[name]
                if level
            )
        ]

    def circles(self):
        """List groups of modules that import each other, directly or not."""
        above = {name: self.own(name) & set(self.paths) for name in self.paths}
        for middle in self.paths:  # after Warshall: whom each one reaches
            for name in self.paths:
                if middle in above[name]:
                    above[name] = above[name] | above[middle]
        return [name for name in self.paths if name in above[name]]

    def full_rooms(self):
        """Name the folders with more modules than a room holds."""
        counts = {}
        for path in self.paths.values():
            counts[path.parent] = counts.get(path.parent, 0) + 1
        return [
            str(room.relative_to(self.source))
            for room, count in counts.items()
            if count > MOST_IN_A_ROOM
        ]
