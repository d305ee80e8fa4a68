"""What a module imports, read from the source."""

from __future__ import annotations

import ast

PACKAGE = "g1_description"
GENERATED = ("msg", "srv")


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
        self.paths.update(
            {
                ".".join(path.relative_to(source).parent.parts): path
                for path in sorted(source.glob("*/*/__init__.py"))
            }
        )
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
                package = name.split(".")[:-level]
                start = ".".join([*package, module] if module else package)
            elif module.split(".")[0] == PACKAGE:
                start = module[len(PACKAGE) + 1 :]
            else:
                continue
            if start in GENERATED:
                continue
            inside = {f"{start}.{other}".lstrip(".") for other in names}
            found |= (inside & set(self.paths)) or {start}
        return found

    def of_package(self, package):
        """Name the modules of a package; those of none belong to the package ""."""
        return [name for name in self.paths if package_of(name) == package]

    def circles(self):
        """List the modules that import themselves, directly or not."""
        return in_circles({name: self.own(name) for name in self.paths})

    def package_circles(self):
        """List the packages that import themselves by way of others."""
        below = {}
        for name in self.paths:
            package = package_of(name) or name
            others = {package_of(other) or other for other in self.own(name)}
            others.discard(package)
            below.setdefault(package, set()).update(others)
        return in_circles(below)


def package_of(module):
    """Name the package that a module lies in."""
    package, dot, _ = module.partition(".")
    return package if dot else ""


def in_circles(below):
    """List who is reached from itself; ``below`` is a dict of sets.

    Source: S. Warshall, A Theorem on Boolean Matrices, J. ACM 9 (1962).
    """
    reached = {name: others & set(below) for name, others in below.items()}
    for middle in reached:
        for name in reached:
            if middle in reached[name]:
                reached[name] = reached[name] | reached[middle]
    return [name for name in reached if name in reached[name]]
