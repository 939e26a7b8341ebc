"""`pointit plugin new`: a package with a plug-in that works, and tests that pass."""

import importlib.resources
import keyword
import re
import sys
from pathlib import Path
from string import Template

import click

from pointit.cli.common import installed_commands
from pointit.commands import replaced_file
from pointit.plugins import GROUPS, ConfigError
from pointit.services.imu_bridge.config import ImuBridgeConfig
from pointit.services.selector.config import SelectorConfig

COMMAND = "command"
KINDS = {
    COMMAND: ("print_selections", "pointit.commands", "command", "$name"),
    "imu-source": ("imu_source", "pointit.imu_sources", "SOURCE", "run --imu $name:HOST"),
    "led-output": ("led_output", "pointit.led_outputs", "OUTPUT", "run --output $name:HOST"),
    "recogniser": ("recogniser", "pointit.recognisers", "RECOGNISER", "listen anna --recogniser $name"),
    "selection-method": ("selection_method", "pointit.selection_methods", "METHOD", "run --method $name"),
    "service": ("service", "pointit.services", "SERVICE", "run --with $name"),
}
"""Kinds of plug-ins: template, group of the entry point, name of the object, and command that uses it."""

PARAMETERS = {"imu-source": ImuBridgeConfig.model_fields, "selection-method": SelectorConfig.model_fields}
"""Parameters beside which those of a plug-in have a section, by kind."""

TEMPLATES = "pointit.testing.templates"
COMMON = ("pyproject.toml", "README.md", ".github/workflows/test.yml")
"""Files of every package."""
FAKE_DEVICE = """[project.entry-points."pointit.fake_devices"]
$name = "$module.fake:DEVICE"

"""
NAME = re.compile(r"[a-z][a-z0-9]*([-_][a-z0-9]+)*\Z")


@click.command("new")
@click.argument("kind", type=click.Choice(list(KINDS)))
@click.argument("name")
@click.option(
    "--folder",
    type=click.Path(path_type=Path, file_okay=False),
    help="folder of the package [default: ./NAME]",
)
def command(*, kind: str, name: str, folder: Path | None) -> None:
    """Write a package with a working plug-in NAME of a KIND, and tests that pass.

    The device of the example is connected by TCP, and simulated in tests. Change its connection and its
    messages; the tests show broken promises.

    Example: pointit plugin new imu-source my-wrist
    """
    module = name.replace("-", "_")
    if not NAME.match(name) or keyword.iskeyword(module) or module in sys.stdlib_module_names | {"pointit"}:
        raise ConfigError(f"{name!r} cannot be a package's name: use a-z, 0-9 and -, such as my-wrist")
    check_free(kind, name)
    target = folder or Path(name)
    if target.exists() and (not target.is_dir() or any(target.iterdir())):
        raise ConfigError(f"{target} exists already: give another --folder, or move it away")
    for path, text in package(kind, name, module).items():
        place = target / path
        try:
            place.parent.mkdir(parents=True, exist_ok=True)
            with replaced_file(place) as part:
                part.write_text(text, encoding="utf-8")
        except OSError as error:
            raise ConfigError(
                f"{place} cannot be written ({error.strerror}): give another --folder"
            ) from error
    use = Template(KINDS[kind][3]).substitute(name=name)
    click.echo(
        f"{target} is written. Then:\n"
        f"  pip install --editable {target} pytest\n"
        f"  pytest {target}\n"
        f"  pointit plugin check {name}\n"
        f"  pointit {use}"
    )


def check_free(kind: str, name: str) -> None:
    """Check that a plug-in of a `kind` can be found by `name` beside those that are installed.

    Raises:
        ConfigError: If it cannot.
    """
    if kind == COMMAND:
        root: object = click.get_current_context().find_root().command
        ours = [entry.name for entry in getattr(root, "entries", ())]
        if name in ours or name in [each.name for each in installed_commands.declared()]:
            raise ConfigError(f"`pointit {name}` is a command: choose another name")
        return
    group = GROUPS[kind]
    if name in group.names:
        raise ConfigError(f"{group.label(name)} is installed: choose another name")
    if name.replace("-", "_") in PARAMETERS.get(kind, {}):
        raise ConfigError(f"{name!r} is a parameter of the service that would use it: choose another name")


def package(kind: str, name: str, module: str) -> dict[str, str]:
    """Return the text of each file of a package, by its path in the package's folder."""
    template, group, thing, use = KINDS[kind]
    article = "an" if kind[0] in "aeio" else "a"
    has_device = kind != COMMAND
    words = {
        "name": name,
        "module": module,
        "kind": kind,
        "article": article,
        "group": group,
        "thing": thing,
        "use": Template(use).substitute(name=name),
        "tests": f"each promise of {article} {kind} is a test" if has_device else "its help and its output",
        "fake": f", `src/{module}/fake.py` what stands for its device in tests" if has_device else "",
        "fake_device": Template(FAKE_DEVICE).substitute(name=name, module=module) if has_device else "",
    }
    sources = importlib.resources.files(TEMPLATES)
    texts = {
        path: Template(
            (sources / "package" / f"{Path(path).name}.txt").read_text(encoding="utf-8")
        ).substitute(words)
        for path in (*COMMON, f"tests/test_{'promises' if has_device else 'command'}.py")
    }
    files = {file: sources / template / file for file in ("__init__.py", "fake.py")}
    if not has_device:
        files = {"__init__.py": importlib.resources.files("pointit.cli.plugins") / f"{template}.py"}
    for file, source in files.items():
        text = source.read_text(encoding="utf-8")
        for word, own in (
            (f"{TEMPLATES}.{template}", module),
            ("template-service", name),
            ("pointit NAME", f"pointit {name}"),
            ("template_service", module),
        ):
            text = text.replace(word, own)
        texts[f"src/{module}/{file}"] = text
    texts[f"src/{module}/py.typed"] = ""
    return texts
