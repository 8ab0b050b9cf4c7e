"""Who may write a file: what another user can change is neither run nor copied into a build.

`gen.builder.ownership` and `hdagen.support.ownership` are the same text, for neither half imports the other.
"""

from __future__ import annotations

import grp
import os
import pwd
import stat
from pathlib import Path

ROOT = 0  # user and group whose right to write changes nothing: they may do so anyway


def find_other_writer(path: Path) -> str:
    """Who else may change ``path`` or put another file in its place, as a clause that names the culprit.

    Symbolic links are followed; of a path that does not exist yet, the folders that do are looked at. A folder where
    everyone or a group may write is safe for what lies in it if it is sticky. A group counts as this user alone if it
    is the private one that many systems give each user.

    Args:
        path: A file or folder.

    Returns:
        Empty where only this user and root may write, all the way up; else a clause such as
        "/shared may be written by everyone".

    Raises:
        OSError: A folder on the way cannot be looked at.

    """
    whole = Path(os.path.realpath(path))
    for place in (whole, *whole.parents):
        try:
            found = place.lstat()
        except FileNotFoundError:
            continue
        if found.st_uid not in (os.geteuid(), ROOT):
            return f"{place} belongs to {_name_user(found.st_uid)}"
        if stat.S_ISDIR(found.st_mode) and found.st_mode & stat.S_ISVTX:
            continue
        if found.st_mode & stat.S_IWOTH:
            return f"{place} may be written by everyone"
        if found.st_mode & stat.S_IWGRP and not _is_private(found.st_gid):
            return f"{place} may be written by the group {_name_group(found.st_gid)}"
    return ""


def _is_private(group: int) -> bool:
    """Whether a group has no other members than this user: root's, or the one that bears the user's name."""
    if group == ROOT:
        return True
    try:
        user, found = pwd.getpwuid(os.geteuid()), grp.getgrgid(group)
    except KeyError:
        return False
    return found.gr_gid == user.pw_gid and found.gr_name == user.pw_name and set(found.gr_mem) <= {user.pw_name}


def _name_user(number: int) -> str:
    try:
        return f"the user {pwd.getpwuid(number).pw_name}"
    except KeyError:
        return f"the user {number}"


def _name_group(number: int) -> str:
    try:
        return grp.getgrgid(number).gr_name
    except KeyError:
        return str(number)
