"""The tables in ``scenes/README.md``, written from the schema and from the bundled scenes.

``python -m warpcloth.scenes.reference scenes/README.md`` brings the file up to date; a test checks that it is.
"""

import sys
from pathlib import Path
from typing import Any, get_args, get_origin

from pydantic.fields import FieldInfo

from warpcloth.fabric import Fabric

from .load import bundled_scenes, load_scene
from .schema.air import AirTable
from .schema.cloth import CLOTHS, InflationTable
from .schema.fabric import FabricTable
from .schema.motion import KeyTable, MotionTable
from .schema.network import NetworkTable
from .schema.obstacle import OBSTACLES
from .schema.pin import PinTable, RegionTable
from .schema.scene import Scene
from .schema.simulation import SimulationTable
from .schema.stage import StageTable
from .schema.table import Table
from .schema.values import Checked

SECTIONS: list[tuple[str, tuple[type[Table], ...]]] = [
    ("Top level", (Scene,)),
    ("`[simulation]`", (SimulationTable,)),
    ("`[air]`", (AirTable,)),
    ("`[[cloth]]`", CLOTHS),
    ("`fabric`", (FabricTable,)),
    ("`inflation`", (InflationTable,)),
    ("`pins`", (PinTable,)),
    ("`box` of a pin", (RegionTable,)),
    ("`motion`", (MotionTable,)),
    ("`keys` of a motion", (KeyTable,)),
    ("`[[obstacle]]`", OBSTACLES),
    ("`[network]`", (NetworkTable,)),
    ("`[stage]`", (StageTable,)),
]


def field_tables() -> str:
    """All fields of a scene file as Markdown."""
    return "\n\n".join(_section(title, tables) for title, tables in SECTIONS)


def scene_table() -> str:
    """The bundled scenes as Markdown."""
    scenes = [load_scene(name) for name in bundled_scenes()]
    rows = [
        f"| {_picture(scene.name)} | `{scene.name}` | {scene.frames} | {scene.title}. {scene.description} |"
        for scene in scenes
    ]
    return "\n".join(["| | scene | frames | what it shows |", "|---|---|---|---|", *rows])


def _picture(name: str) -> str:
    """An image of a scene, where there is one."""
    there = (Path(__file__).parent / "pictures" / f"{name}.jpg").is_file()
    return f'<img src="pictures/{name}.jpg" width="240" alt="{name}">' if there else ""


def refreshed(text: str) -> str:
    """A README with its generated parts brought up to date.

    Raises:
        ValueError: The text lacks the lines that such a part stands between.
    """
    for name, content in (("scenes", scene_table()), ("fields", field_tables())):
        begin, end = f"<!-- {name}: begin (generated) -->", f"<!-- {name}: end -->"
        before, found, rest = text.partition(begin)
        _, closed, after = rest.partition(end)
        if not found or not closed:
            raise ValueError(f"the text has no lines {begin} and {end}")
        text = f"{before}{begin}\n\n{content}\n\n{end}{after}"
    return text


def _section(title: str, tables: tuple[type[Table], ...]) -> str:
    """A heading; where there are several shapes, first what they share and then what each adds."""
    if len(tables) == 1:
        return f"### {title}\n\n{_sentence(tables[0])}\n\n{_rows(tables[0].model_fields)}"
    base: type[Table] = tables[0].__bases__[0]
    parts = [f"### {title}\n\n{_sentence(base)}\n\n{_rows(base.model_fields)}"]
    for table in tables:
        own = {name: info for name, info in table.model_fields.items() if name not in base.model_fields}
        shape = get_args(own.pop("shape").annotation)[0]
        parts.append(f'#### `shape = "{shape}"`\n\n{_sentence(table)}\n\n{_rows(own)}')
    return "\n\n".join(parts)


def _sentence(table: type[Table]) -> str:
    return (table.__doc__ or "").split("\n\n")[0].replace("\n    ", " ")


def _rows(fields: dict[str, FieldInfo]) -> str:
    head = "| field | value | default | meaning |\n|---|---|---|---|"
    usual = vars(Fabric()) if fields is FabricTable.model_fields else {}
    return "\n".join([head, *(_row(name, info, usual.get(name)) for name, info in fields.items())])


def _row(name: str, info: FieldInfo, usual: Any) -> str:
    """A field; ``usual`` is what it has where a scene says nothing, if the schema leaves that to the simulator."""
    cells = [f"`{name}`", _kind(info.annotation, info.metadata), _default(info, usual), info.description or ""]
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"


def _default(info: FieldInfo, usual: Any) -> str:
    if info.is_required():
        return "required"
    value = usual if info.default is None else info.default
    return "–" if value is None or isinstance(value, Table) else f"`{_toml(value)}`"


def _toml(value: Any) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return f'"{value}"'
    if isinstance(value, tuple | list):
        return f"[{', '.join(_toml(item) for item in value)}]"
    return f"{value:g}" if isinstance(value, float) else str(value)


def _kind(annotation: Any, metadata: list[Any]) -> str:
    """What may stand in a field, in words."""
    for item in metadata:
        if isinstance(item, Checked):
            return item.label
    arguments = get_args(annotation)
    if type(None) in arguments:
        inner = next(argument for argument in arguments if argument is not type(None))
        return _kind(*_unwrapped(inner))
    if get_origin(annotation) is list:
        return f"list of {_kind(*_unwrapped(arguments[0]))}"
    if isinstance(annotation, type) and issubclass(annotation, Table):
        return "table"
    if annotation is bool:
        return "`true` or `false`"
    if arguments and all(isinstance(argument, str) for argument in arguments):
        return ", ".join(f'`"{argument}"`' for argument in arguments)
    return "tables" if arguments else str(annotation)


def _unwrapped(annotation: Any) -> tuple[Any, list[Any]]:
    """An annotation without ``Annotated``, and what that held."""
    if hasattr(annotation, "__metadata__"):
        return annotation.__origin__, list(annotation.__metadata__)
    return annotation, []


if __name__ == "__main__":
    readme = Path(sys.argv[1])
    readme.write_text(refreshed(readme.read_text(encoding="utf-8")), encoding="utf-8")
