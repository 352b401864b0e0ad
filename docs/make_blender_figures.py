"""Draw the figures of the page on Blender: ``PYTHON docs/make_blender_figures.py FOLDER``, into ``docs/figures/``.

The extension itself makes the round trip of a small scene in FOLDER, a new one, and its panel is drawn from the code
that shows it. PYTHON is one with Blender's module bpy (5.0 or newer) and Pillow; fpsboost must be on PATH. Takes about
a minute.
"""

from __future__ import annotations

import importlib.util
import json
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any
from xml.sax.saxutils import escape

import bpy
from PIL import Image, ImageChops, ImageDraw, ImageFont

ROOT = Path(__file__).parents[1]
FIGURES = ROOT / "docs" / "figures"

SIZE = (300, 170)
FRAME = 4
"""The made frame that is shown, after the rendered one before it."""

GAP, LINE = 12, 20
"""Between panels, and of a line of text, pixels."""


def main() -> None:
    """Draw both figures, and print the size of each file."""
    folder = Path(sys.argv[1]).absolute()
    extension = load_extension()
    scene = stage()
    scene.fpsboost.folder, scene.fpsboost.budget = str(folder), 10
    for name in ("prepare", "render", "convert", "plan", "render_regions", "merge"):
        print(name, flush=True)
        if name == "render":
            bpy.ops.render.render(animation=True)
        else:
            getattr(bpy.ops.fpsboost, name)()
    for path in (draw_panel(extension, scene), draw_round_trip(folder)):
        print(f"{path.relative_to(ROOT)}: {path.stat().st_size / 1000:.0f} kB")


def load_extension() -> ModuleType:
    """Import the extension from its folder, as Blender would, and register it."""
    folder = ROOT / "integrations" / "blender"
    spec = importlib.util.spec_from_file_location(
        "bl_ext_fpsboost", folder / "__init__.py", submodule_search_locations=[str(folder)]
    )
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    module.register()
    return module


# ---------------------------------------------------------------------------------------------------------------- scene


def stage() -> Any:
    """Build a scene: a glass ball goes past a metal ring and coloured boxes on a chequered floor."""
    scene = bpy.context.scene
    for thing in list(scene.objects):
        if thing.type == "MESH":
            bpy.data.objects.remove(thing)
    bpy.ops.mesh.primitive_plane_add(size=40)
    bpy.context.object.data.materials.append(checker())
    bpy.ops.mesh.primitive_torus_add(
        location=(1.6, 0.2, 1.3), major_radius=0.95, minor_radius=0.33, major_segments=96, minor_segments=32
    )
    ring = bpy.context.object
    bpy.ops.object.shade_smooth()
    ring.data.materials.append(material("metal", (0.9, 0.6, 0.3, 1), metallic=1.0, roughness=0.15))
    for frame, angle in ((1, 0.4), (9, 1.2)):
        ring.rotation_euler = (1.2, 0, angle)
        ring.keyframe_insert("rotation_euler", frame=frame)
    for place, colour in (
        ((-2.5, 2.5), (0.8, 0.1, 0.1, 1)),
        ((-0.5, 3.2), (0.1, 0.4, 0.8, 1)),
        ((3.8, 2.5), (0.1, 0.6, 0.2, 1)),
    ):
        bpy.ops.mesh.primitive_cube_add(size=1.6, location=(*place, 0.8), rotation=(0, 0, place[0]))
        bpy.context.object.data.materials.append(material("box", colour, roughness=0.6))
    bpy.ops.mesh.primitive_uv_sphere_add(radius=0.9, location=(-2, -0.8, 0.9), segments=64, ring_count=32)
    ball = bpy.context.object
    bpy.ops.object.shade_smooth()
    ball.data.materials.append(material("glass", (1, 1, 1, 1), transmission=1.0, roughness=0.0))
    for frame, x in ((1, -2.2), (9, -0.4)):
        ball.location.x = x
        ball.keyframe_insert("location", frame=frame)
    camera = scene.camera
    camera.location, camera.rotation_euler, camera.data.lens = (0.2, -9.5, 3.2), (1.34, 0, 0), 40
    scene.render.engine, scene.cycles.samples, scene.cycles.device = "CYCLES", 64, "CPU"
    scene.render.resolution_x, scene.render.resolution_y = SIZE
    scene.frame_start, scene.frame_end = 1, 9
    return scene


def material(name: str, colour: tuple[float, ...], transmission: float = 0.0, **more: float) -> Any:
    """Make a material of Blender's principled kind."""
    made = bpy.data.materials.new(name)
    inputs = made.node_tree.nodes["Principled BSDF"].inputs
    inputs["Base Color"].default_value = colour
    inputs["Transmission Weight"].default_value = transmission
    for key, value in more.items():
        inputs[key.title()].default_value = value
    return made


def checker() -> Any:
    """Make a chequered material."""
    made = material("checker", (1, 1, 1, 1), roughness=0.5)
    nodes, links = made.node_tree.nodes, made.node_tree.links
    texture = nodes.new("ShaderNodeTexChecker")
    texture.inputs["Scale"].default_value = 40
    texture.inputs["Color1"].default_value = (0.7, 0.68, 0.62, 1)
    texture.inputs["Color2"].default_value = (0.12, 0.14, 0.18, 1)
    links.new(texture.outputs["Color"], nodes["Principled BSDF"].inputs["Base Color"])
    return made


# -------------------------------------------------------------------------------------------------------- round trip


def draw_round_trip(folder: Path) -> Path:
    """Draw a rendered frame and what becomes of the one after it."""
    made, merged = (as_seen(folder / name, FRAME) for name in ("made", "merged"))
    planned = json.loads((folder / "plan" / "plan.json").read_text())
    (regions,) = (frame["regions"] for frame in planned["frames"] if frame["number"] == FRAME)
    outlined = made.copy()
    for x, y, width, height in regions:
        ImageDraw.Draw(outlined).rectangle((x, y, x + width - 1, y + height - 1), outline=(255, 60, 0), width=2)
    confidence = Image.open(folder / "confidence" / f"{FRAME:04d}.png").convert("RGB")
    change = ImageChops.difference(made, merged).point(lambda level: min(255, 4 * level))
    return save(
        "blender-round-trip",
        [
            [(f"Frame {FRAME - 1}, rendered", as_seen(folder / "renders", FRAME - 1)), (f"Frame {FRAME}, made", made)],
            [("Confidence, white is certain", confidence), ("Regions to render", outlined)],
            [(f"Frame {FRAME}, merged", merged), ("What that changed, four times", change)],
        ],
    )


def as_seen(folder: Path, number: int) -> Image.Image:
    """Return a frame as Blender's sequencer shows it, with the scene's view transform."""
    scene = bpy.data.scenes.new("view")
    (scene.render.resolution_x, scene.render.resolution_y), scene.render.resolution_percentage = SIZE, 100
    strips = scene.sequence_editor_create().strips
    strips.new_image(name="view", filepath=str(folder / f"{number:04d}.exr"), channel=1, frame_start=1)
    scene.render.image_settings.file_format = "PNG"
    path = folder.parent / "view.png"
    scene.render.filepath = str(path)
    bpy.ops.render.render(write_still=True, scene=scene.name)
    bpy.data.scenes.remove(scene)
    with Image.open(path) as image:
        return image.convert("RGB")


def save(name: str, rows: list[list[tuple[str, Image.Image]]]) -> Path:
    """Save rows of pictures with titles as a WebP file; return its path."""
    step = SIZE[0] + GAP, SIZE[1] + LINE + GAP // 2
    drawn = Image.new("RGB", (step[0] * len(rows[0]) + GAP, step[1] * len(rows) + GAP // 2), "white")
    pen, font = ImageDraw.Draw(drawn), ImageFont.load_default(12)
    for j, row in enumerate(rows):
        for i, (title, picture) in enumerate(row):
            left, top = GAP + i * step[0], j * step[1] + GAP // 2
            pen.text((left, top), title, "#222222", font)
            drawn.paste(picture, (left, top + LINE))
    path = FIGURES / f"{name}.webp"
    drawn.save(path, quality=90, method=6)
    return path


# ---------------------------------------------------------------------------------------------------------------- panel


class Layout:
    """A layout that notes what a panel puts into it, as rows of texts; a property has two, an operator one."""

    def __init__(self, rows: list[list[Any]], row: list[Any] | None = None) -> None:
        self._rows, self._row = rows, row
        self.use_property_split = self.use_property_decorate = self.enabled = True

    def column(self, align: bool = False) -> Layout:
        """Begin a column, below what is there."""
        self._rows.append([])
        return Layout(self._rows)

    def row(self, align: bool = False) -> Layout:
        """Begin a row."""
        row: list[Any] = []
        self._rows.append(row)
        return Layout(self._rows, row)

    def prop(self, owner: Any, name: str) -> None:
        """Note a property and its value."""
        known = owner.bl_rna.properties[name]
        value = getattr(owner, name)
        if isinstance(value, set):
            for item in known.enum_items:
                self._add((known.name if item == known.enum_items[0] else "", item.name, item.identifier in value))
        else:
            self._add((known.name, f"{value:.0f}%" if isinstance(value, float) else str(value), None))

    def operator(self, name: str, text: str = "", icon: str = "") -> Any:
        """Note a button."""
        group, operator = name.split(".")
        self._add(text or getattr(getattr(bpy.ops, group), operator).get_rna_type().name)
        return SimpleNamespace()

    def _add(self, entry: Any) -> None:
        if self._row is None:
            self._rows.append([entry])
        else:
            self._row.append(entry)


def draw_panel(extension: ModuleType, scene: Any) -> Path:
    """Draw the panel of the extension in the colours of Blender's default theme."""
    rows: list[list[Any]] = []
    scene.fpsboost.folder = "//fpsboost/"
    panel = SimpleNamespace(layout=Layout(rows))
    extension.panel.FPSBOOST_PT_output.draw(panel, SimpleNamespace(scene=scene))
    width, parts, y = 360, list[str](), 30
    for row in rows:
        if not row:
            y += 8
            continue
        if isinstance(row[0], tuple):
            parts += draw_property(*row[0], y)
        else:
            each = (width - 20 - 4 * (len(row) - 1)) / len(row)
            for i, text in enumerate(row):
                parts += draw_button(text, 10 + i * (each + 4), y, each)
        y += 24
    head = '<text x="26" y="19" fill="#e6e6e6">fpsboost</text><path d="M9 10l8 0l-4 7z" fill="#e6e6e6"/>'
    path = FIGURES / "blender-panel.svg"
    path.write_text(
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="{y + 8}" viewBox="0 0 {width} {y + 8}" '
        'font-family="Inter, DejaVu Sans, Arial, sans-serif" font-size="12">\n'
        f'<rect width="{width}" height="{y + 8}" rx="5" fill="#3d3d3d"/>{head}\n' + "\n".join(parts) + "\n</svg>\n",
        encoding="utf-8",
    )
    return path


def draw_property(name: str, value: str, chosen: bool | None, y: int) -> list[str]:
    """Draw a property: its name, and a field with its value or one that is chosen or not."""
    fill = {None: "#1d1d1d", True: "#4772b3", False: "#545454"}[chosen]
    return [
        f'<text x="140" y="{y + 15}" text-anchor="end" fill="#e6e6e6">{escape(name)}</text>',
        f'<rect x="148" y="{y}" width="202" height="21" rx="4" fill="{fill}"/>',
        f'<text x="156" y="{y + 15}" fill="#e6e6e6">{escape(value)}</text>',
    ]


def draw_button(text: str, x: float, y: int, width: float) -> list[str]:
    """Draw a button."""
    return [
        f'<rect x="{x:.0f}" y="{y}" width="{width:.0f}" height="21" rx="4" fill="#656565"/>',
        f'<text x="{x + width / 2:.0f}" y="{y + 15}" text-anchor="middle" fill="#ffffff">{escape(text)}</text>',
    ]


if __name__ == "__main__":
    main()
