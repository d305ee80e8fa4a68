"""Reads Python against lists of old libraries: what it asks for that they do not have.

It follows imports, and the classes of what calls of them return: a member of an object
is too new if the class has it now and had it not. Of other objects it knows the names
alone: one that no old class has, and a common one has now, is taken for theirs.
"""

import ast
import re

UNCHECKED = {"TYPE_CHECKING", "version_info"}
"""A condition that has one of these names chooses between old and new."""
COMMON = ("numpy", "scipy", "builtins", "pathlib", "random")
"""Where the classes come from whose new members are known by their names alone."""
DEFINED = re.compile(r"^ *(?:def|class) (\w+)", re.M)
"""What a module defines, also inside of something else."""
ALTERNATIVE = ("from_", "random", "identity", "match_")
"""Beginnings of the names of class methods that make an object."""


class Names:
    """What the modules of an inventory offer."""

    def __init__(self, old, new):
        """Compare two inventories.

        Args:
            old: Of the oldest versions.
            new: Of what is installed.
        """
        self.modules = {name: content for name, content in old.items() if content}
        self.roots = {name.split(".")[0] for name in old}
        known = {member for _, _, entry in _classes(old) for member in entry}
        self._added = {
            f"{module}.{name}": {*entry} - {*old[module][name]}
            for module, name, entry in _classes(new)
            if isinstance(old.get(module, {}).get(name), dict)
        }
        self.new_members = {
            member: f"{module}.{name}"
            for module, name, entry in _classes(new)
            if name in old.get(module, {}) and module.split(".")[0] in COMMON
            for member in entry
            if member not in known
        }

    def find(self, dotted):
        """Look a name up.

        Returns:
            What is known of it; None if nothing is. An AttributeError says what is
            missing.
        """
        parts = dotted.split(".")
        for cut in range(len(parts), 0, -1):
            module = ".".join(parts[:cut])
            if module in self.modules:
                return self._inside(module, parts[cut:])
        return None

    def _inside(self, module, rest):
        """Look up what stands behind the name of a module."""
        entry = self.modules[module]
        for depth, name in enumerate(rest):
            if not isinstance(entry, dict):
                return None
            if name not in entry and not name.startswith("_"):
                where = ".".join((module, *rest[:depth]))
                if depth and name not in self._added.get(where, set()):
                    return None  # of the object, not of its class
                raise AttributeError(f"{where} has no {name}")
            entry = entry.get(name)
        return entry


def _classes(modules):
    """Go through the classes of an inventory: module, name, members."""
    for module, content in modules.items():
        for name, entry in content.items():
            if isinstance(entry, dict):
                yield module, name, entry


class Reader(ast.NodeVisitor):
    """Collects in a module what an inventory does not have."""

    def __init__(self, names):
        """Begin without findings.

        Args:
            names: Names.
        """
        self.names, self.found = names, []
        self._imported, self._objects = {}, {}
        self._others = {"self", "cls"}  # what belongs to other libraries, or to us
        self._own = set()

    def read(self, text):
        """Read a module; give a sentence for each finding."""
        tree = ast.parse(text)
        self._own.update(DEFINED.findall(text))
        self.visit(tree)
        return self.found

    def visit_If(self, node):
        """Leave out what only runs with newer versions, or not at all."""
        words = {
            getattr(part, "id", getattr(part, "attr", ""))
            for part in ast.walk(node.test)
        }
        if not words & UNCHECKED:
            self.generic_visit(node)

    def visit_Import(self, node):
        """Remember a module; it must be there."""
        for alias in node.names:
            if alias.name.split(".")[0] in self.names.roots:
                name = alias.name if alias.asname else alias.name.split(".")[0]
                self._imported[alias.asname or name] = name
                self._look_up(node, alias.name)
            else:
                self._others.add(alias.asname or alias.name.split(".")[0])

    def visit_ImportFrom(self, node):
        """Remember names of a module; they must be there."""
        module = node.module or ""
        if node.level or module.split(".")[0] not in self.names.roots:
            self._others.update(alias.asname or alias.name for alias in node.names)
            return
        for alias in node.names:
            name = f"{module}.{alias.name}"
            self._imported[alias.asname or alias.name] = name
            self._look_up(node, name)

    def visit_Assign(self, node):
        """Remember of which class a variable is."""
        self.generic_visit(node)
        kind = self._class_of(node.value)
        for target in node.targets:
            if isinstance(target, ast.Name):
                self._objects[target.id] = kind

    def visit_Attribute(self, node):
        """Look up a name, or the method of an object."""
        dotted = self._dotted(node)
        if dotted:
            self._look_up(node, dotted)
            return
        kind = self._class_of(node.value)
        if kind:
            self._look_up(node, f"{kind}.{node.attr}")
        elif node.attr in self.names.new_members and self._may_be_theirs(node):
            self._tell(node, f"{self.names.new_members[node.attr]} has no {node.attr}")
        self.generic_visit(node)

    def visit_Call(self, node):
        """Look up the keywords of a call."""
        self.generic_visit(node)
        dotted = self._dotted(node.func)
        if not dotted and isinstance(node.func, ast.Attribute):
            kind = self._class_of(node.func.value)
            dotted = kind and f"{kind}.{node.func.attr}"
        try:
            entry = self.names.find(dotted) if dotted else None
        except AttributeError:
            return
        entry = entry.get("") if isinstance(entry, dict) else entry
        if entry is not None:
            for keyword in node.keywords:
                if keyword.arg and keyword.arg not in entry.split():
                    self._tell(node, f"{dotted} takes no {keyword.arg}")

    def _may_be_theirs(self, node):
        """Tell whether a method may be one of a listed class."""
        root = node.value
        while isinstance(root, (ast.Attribute, ast.Call, ast.Subscript)):
            root = root.func if isinstance(root, ast.Call) else root.value
        is_other = isinstance(root, ast.Name) and root.id in self._others
        return not is_other and node.attr not in self._own

    def _dotted(self, node):
        """Give the full name of what was imported; None of anything else."""
        if isinstance(node, ast.Attribute):
            before = self._dotted(node.value)
            return before and f"{before}.{node.attr}"
        return self._imported.get(node.id) if isinstance(node, ast.Name) else None

    def _class_of(self, node):
        """Give the class of an expression's value; None if it is not known."""
        if isinstance(node, ast.Name):
            return self._objects.get(node.id)
        if isinstance(node, (ast.BinOp, ast.Subscript)):
            return self._class_of(getattr(node, "left", None) or node.value)
        if not isinstance(node, ast.Call):
            return None
        dotted = self._dotted(node.func)
        if dotted:
            owner, _, method = dotted.rpartition(".")
            kind = owner if method.startswith(ALTERNATIVE) else dotted
            return kind if self._is_class(kind) else None
        is_inverse = isinstance(node.func, ast.Attribute) and node.func.attr == "inv"
        return self._class_of(node.func.value) if is_inverse else None

    def _is_class(self, dotted):
        """Tell whether a name is one of a class."""
        try:
            return isinstance(self.names.find(dotted), dict)
        except AttributeError:
            return False

    def _look_up(self, node, dotted):
        """Note a name that is not there."""
        try:
            self.names.find(dotted)
        except AttributeError as error:
            self._tell(node, str(error))

    def _tell(self, node, sentence):
        """Note a finding with its place."""
        self.found.append(f"line {node.lineno}: {sentence}")
