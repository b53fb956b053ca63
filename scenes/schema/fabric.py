"""What the cloth of a scene is made of."""

import difflib
from typing import Annotated, Any, Self

from pydantic import model_validator

from warpcloth.errors import InputError
from warpcloth.fabric import Fabric, rigidity_of_length
from warpcloth.fabric_library import fabrics, library_fabric

from .table import Table, field
from .values import Color, Text, at_least_zero, positive, refuse

_PLAIN = Fabric()
_SHEET = {"areal_density", "stretch_stiffness", "shear_stiffness", "bending_rigidity"}  # what makes one fabric another


class FabricTable(Table):
    """What a cloth is made of: properties of the sheet, which do not depend on the resolution of its mesh.
    `fabric = "denim"` takes a fabric of the library (`warpcloth fabrics` lists them), and a table with its name changes
    some of its properties; the defaults here are those of a table without such a name, and of cloth without `fabric`.
    A fabric with a name of your own needs a density or stiffness of its own, too, and all if its name is much like one
    of the library's.
    """

    name: Annotated[str, Text(r"\S(.*\S)?", "a name", 200)] = field(
        _PLAIN.name, "Name of a fabric of the library, or one of your own, for reports."
    )
    areal_density: Annotated[float, positive("kg/m²", 1e3)] | None = field(None, "Mass per area.")
    thickness: Annotated[float, positive("m", 0.1)] | None = field(
        None, "Contact thickness: two layers come to rest this far apart."
    )
    stretch_stiffness: Annotated[float, positive("N/m", 1e7)] | None = field(
        None, "Young's modulus of the sheet along the warp (x of a grid or mesh), force per width and strain."
    )
    stretch_stiffness_weft: Annotated[float, positive("N/m", 1e7)] | None = field(
        None, "The same along the weft; by default that of the warp."
    )
    shear_stiffness: Annotated[float, at_least_zero("N/m", 1e7)] | None = field(
        None, "Shear modulus of the sheet, at most its stretch stiffness; on meshes see their `springs`."
    )
    bending_rigidity: Annotated[float, at_least_zero("N m", 10.0)] | None = field(
        None, "Moment per width and curvature for bending along the warp."
    )
    bending_rigidity_weft: Annotated[float, at_least_zero("N m", 10.0)] | None = field(
        None, "The same along the weft; by default that of the warp."
    )
    twist_ratio: Annotated[float, positive("", 10.0)] | None = field(
        None,
        "Resistance to twist over the geometric mean of those two; 1 is an isotropic sheet's, woven cloth has less.",
    )
    bending_length: Annotated[float, at_least_zero("m", 1.0)] | None = field(
        None, "Another way to give the bending rigidity: (rigidity/weight per area)^(1/3), as ASTM D1388 measures it."
    )
    bending_hysteresis: Annotated[float, at_least_zero("N", 10.0)] | None = field(
        None, "Moment per width by which bending lags behind (2HB of the KES test)."
    )
    bend_stiffness: Annotated[float, at_least_zero("N/m", 1e7)] | None = field(
        None, "Stiffness per width of springs that join every other vertex: the tutorials' bending, not a fabric's."
    )
    damping_time: Annotated[float, at_least_zero("s", 10.0)] | None = field(
        None, "Damping of each spring over its stiffness; strain dies out faster the larger it is."
    )
    friction: Annotated[float, at_least_zero("", 10.0)] | None = field(
        None, "Coulomb coefficient; a pair has the geometric mean of its two."
    )
    air_drag: Annotated[float, at_least_zero("", 100.0)] | None = field(
        None, "Coefficient of the air's force across the sheet."
    )
    air_friction: Annotated[float, at_least_zero("", 100.0)] | None = field(
        None, "Coefficient of the air's force along the sheet."
    )
    strain_limit: Annotated[float, at_least_zero("", 10.0)] | None = field(
        None, "Strain beyond which the sheet stiffens by `limit_stiffness`; by default it never does."
    )
    limit_stiffness: Annotated[float, at_least_zero("N/m", 1e7)] | None = field(
        None, "By how much the stretch stiffness along the warp is greater beyond the limit."
    )
    color: Color | None = field(None, "Display colour, linear RGB.")

    @model_validator(mode="before")
    @classmethod
    def _by_name(cls, data: Any) -> Any:
        """A fabric of the library by its name alone."""
        if not isinstance(data, str):
            return data
        if data not in fabrics():
            raise refuse("must be a table or the name of a fabric (`warpcloth fabrics`)", _suggestion(data))
        return {"name": data}

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        if self.bending_length is not None and self.bending_rigidity is not None:
            raise refuse("must have a bending_length or a bending_rigidity, not both")
        if (self.strain_limit is None) != (self.limit_stiffness is None):
            raise refuse("must have a strain_limit and a limit_stiffness, or neither, as one alone does nothing")
        self._check_name()
        try:
            self.build()
        except InputError as error:
            reason = str(error).removeprefix(f"Fabric '{self.name}': ").rstrip(".")
            raise refuse(f"cannot be: its {reason}") from None
        return self

    def _check_name(self) -> None:
        """A name that is not in the library is one's own only with properties that make a fabric of it, and one that
        may be a slip only with all of these, as the library's fabric would have given them."""
        if self.name in fabrics() or self.name == _PLAIN.name:
            return
        given = {name for name, value in self if value is not None}
        missing = _SHEET - given - ({"bending_rigidity"} if "bending_length" in given else set())
        slip = bool(difflib.get_close_matches(self.name, list(fabrics()), n=1, cutoff=0.75))
        if missing == _SHEET or (slip and missing):
            raise refuse(
                f"must have the name of a fabric, or {', '.join(sorted(_SHEET))} of its own, not '{self.name}'",
                _suggestion(self.name),
            )

    def build(self) -> Fabric:
        """The simulator's fabric."""
        given: dict[str, Any] = {name: value for name, value in self if value is not None}
        length = given.pop("bending_length", None)
        entry = fabrics().get(self.name)
        density = given.get("areal_density", (_PLAIN if entry is None else entry.fabric).areal_density)
        if length is not None:
            given["bending_rigidity"] = rigidity_of_length(length, density)
            given.setdefault("bending_rigidity_weft", None)
        return Fabric(**given) if entry is None else library_fabric(given.pop("name"), **given)


def _suggestion(name: str) -> str:
    close = difflib.get_close_matches(name, list(fabrics()), n=1, cutoff=0.5)
    return f"; did you mean '{close[0]}'?" if close else f": {', '.join(fabrics())}"
