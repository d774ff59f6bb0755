"""Marker layouts: what each marker of a recording is (TOML)."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Literal

from pydantic import Field, model_validator

from mocap_fit.settings_file import StrictModel, list_shipped, load_settings


class LayoutMarker(StrictModel):
    """One marker of a layout.

    Parameters
    ----------
    name
        Name of the marker in recordings.
    role
        ``"face"``: fitted; ``"head"``: a rigid reference of the head's motion.
    feature_point
        MPEG-4 feature point that it sits on.
    region
        Regions of the face whose triangles it may be tied to, so that a marker on the upper lip
        is never tied to the lower one; all of the skin by default.
    weight
        Weight in the fit, or of a head marker in the head's pose; above 0, no unit.
    orientation
        Whether it is one of the strategic points of the orientation fit (Beskow eq. 1); needs a
        feature point.
    position
        Position on the built-in head, ``(x, y, z)``, millimetres, for simulation and pictures.
        Optional for a face marker with a feature point.
    """

    name: str = Field(min_length=1)
    role: Literal["face", "head"] = "face"
    feature_point: str | None = None
    region: tuple[str, ...] = ()
    weight: float = Field(default=1.0, gt=0)
    orientation: bool = False
    position: tuple[float, float, float] | None = None

    @model_validator(mode="after")
    def _check_marker(self) -> LayoutMarker:
        """Check that the marker has what its role needs."""
        if self.orientation and self.feature_point is None:
            raise ValueError(f"'{self.name}' has orientation = true but no feature_point")
        if self.role == "face" and self.feature_point is None and not self.region:
            raise ValueError(f"'{self.name}' needs a feature_point or a region")
        return self


class Layout(StrictModel):
    """A marker layout.

    Parameters
    ----------
    name
        Name of the layout.
    description
        One sentence for people.
    marker_offset
        Height of a marker's centre above the skin, millimetres: half the diameter of a marker that
        is glued on, 0 for a landmark.
    size_varies
        Whether recordings must first be brought to the size of the reference pose by their head
        markers: true for landmarks of a video, whose scale drifts; false for measured markers.
    reference_parameters
        Parameter → value in the reference pose, 0 to 1; 0 for others (jaw and lips closed).
    markers
        Markers, in any order.
    """

    name: str = ""
    description: str = ""
    marker_offset: float = Field(default=0.0, ge=0, le=20)
    size_varies: bool = False
    reference_parameters: dict[str, float] = Field(default_factory=dict)
    markers: tuple[LayoutMarker, ...]

    @model_validator(mode="after")
    def _check_markers(self) -> Layout:
        """Check that the markers are enough and do not contradict each other."""
        names = [marker.name for marker in self.markers]
        duplicates = sorted(name for name, count in Counter(names).items() if count > 1)
        if duplicates:
            raise ValueError(f"more than one marker is called {', '.join(duplicates)}")
        if not self.face_markers:
            raise ValueError("no marker has the role 'face'")
        if self.size_varies and len(self.head_markers) < 3:
            raise ValueError("size_varies needs three or more markers with the role 'head'")
        strategic = [m for m in self.markers if m.orientation]
        if len(strategic) < 3:
            raise ValueError(
                f"{len(strategic)} markers have orientation = true; three or more are needed"
            )
        return self

    @property
    def face_markers(self) -> tuple[LayoutMarker, ...]:
        """Markers that are fitted."""
        return tuple(marker for marker in self.markers if marker.role == "face")

    @property
    def head_markers(self) -> tuple[LayoutMarker, ...]:
        """Markers that are rigid references of the head's motion."""
        return tuple(marker for marker in self.markers if marker.role == "head")

    def __repr__(self) -> str:
        return (
            f"Layout '{self.name}': {len(self.face_markers)} face markers, "
            f"{len(self.head_markers)} head markers"
        )

    __str__ = __repr__


def list_layouts() -> tuple[str, ...]:
    """List the layouts that come with the package.

    Returns
    -------
    tuple of str
        Names that `load_layout` takes, sorted.
    """
    return list_shipped(__package__, "layouts")


def load_layout(name: str | Path) -> Layout:
    """Load a marker layout.

    Parameters
    ----------
    name
        Name of a layout that comes with the package, or a TOML file.

    Returns
    -------
    Layout
        The layout; one without a name has that of its file.

    Raises
    ------
    MissingFileError
        If there is no such layout.
    ConfigurationError
        If it contradicts itself; the message says where.

    See Also
    --------
    fit_speaker : Ties the markers of a layout to a face.
    read_tracks : Read the markers of a recording.

    Examples
    --------
    >>> import mocap_fit as mf
    >>> layout = mf.load_layout("face30-head5")
    >>> layout
    Layout 'face30-head5': 30 face markers, 5 head markers
    >>> [marker.name for marker in layout.head_markers][:2]
    ['head_bridge', 'head_rim_left']
    """
    layout = load_settings(Layout, name, package=__package__, folder="layouts", noun="layout")
    return layout if layout.name else layout.model_copy(update={"name": Path(name).stem})
