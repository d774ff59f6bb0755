"""The built-in head, as others ask for it: kept between runs, so that it is there at once."""

from __future__ import annotations

from pathlib import Path

from mocap_fit.face.builtin.cache import get_cache_folder, load_mesh, save_mesh, source_key
from mocap_fit.face.mesh import Mesh


def load_built_in_head(*, use_cache: bool = True) -> Mesh:
    """The head that comes with mocap-fit: neutral, mirror-symmetric, lips closed.

    It is made in code (about a second) and kept in the user's cache folder, or the folder that
    the environment variable ``MOCAP_FIT_CACHE`` names. The same version gives the same bytes,
    kept or not.

    Parameters
    ----------
    use_cache
        False builds it anew and leaves the cache alone.

    Returns
    -------
    Mesh
        Parts ``skin``, ``teeth_upper``, ``teeth_lower``, ``gums_upper``, ``gums_lower``,
        ``tongue``, ``eye_left``, ``eye_right``, ``brow_left``, ``brow_right``; regions of the
        skin; MPEG-4 feature points. Origin between the ears at the height of the mouth.
    """
    if use_cache:
        here = Path(__file__).parent
        key = source_key(here.parent / "mesh.py", *here.glob("*.py"))
        path = get_cache_folder() / f"head-{key}.npz"
        kept = load_mesh(path)
        if kept is not None:
            return kept
    # Building needs scipy, whose import takes longer than loading the whole head.
    from mocap_fit.face.builtin.assemble import build_head

    mesh = build_head()
    if use_cache:
        save_mesh(mesh, path)
    return mesh
