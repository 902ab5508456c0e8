"""A file that is written during the recording; its name is ``<name>.part`` until the file is
complete. An existing file is never overwritten.
"""

import errno
import os
from pathlib import Path

from stepdiag.base.disk.system import NEW_FILE, sync_file, sync_folder

PART_SUFFIX = ".part"
_NO_HARD_LINKS = (errno.EPERM, errno.ENOTSUP, errno.EOPNOTSUPP, errno.EMLINK)


class PartFile:
    """Stores bytes in memory and writes them to disk on request.

    A failing disk raises no error in the writer of this file. Bytes that a full disk refuses remain
    in memory until there is space again, so that no record is torn. Only one thread may use the
    file.
    """

    def __init__(self, path: Path, suffix: str = PART_SUFFIX) -> None:
        """Create the file ``path`` with the suffix. Raises FileExistsError if this file or ``path``
        exists.
        """
        if path.exists():
            raise FileExistsError(errno.EEXIST, os.strerror(errno.EEXIST), str(path))
        self.path = path
        self.part = path.with_name(path.name + suffix)
        self._descriptor = os.open(self.part, NEW_FILE, 0o644)
        self._waiting = bytearray()
        self._written = 0

    def write(self, data: bytes) -> int:
        self._waiting += data
        return len(data)

    def tell(self) -> int:
        """Return the position of the next byte in the file."""
        return self._written + len(self._waiting)

    def flush(self) -> None:
        """Do nothing, because the owner of the file decides when to call `drain`."""

    @property
    def waiting(self) -> int:
        return len(self._waiting)

    def drain(self) -> None:
        """Pass all stored bytes to the operating system. Raises OSError; refused bytes are stored
        for the next call.
        """
        while self._waiting:
            count = os.write(self._descriptor, self._waiting)
            del self._waiting[:count]
            self._written += count

    def sync(self) -> None:
        """Wait until the bytes of earlier `drain` calls would survive a power failure."""
        sync_file(self._descriptor)

    def publish(self) -> None:
        """Rename the complete file to its final name. Raises FileExistsError if another file has
        this name; the ``.part`` file then remains. The call may be repeated after an OSError other
        than FileExistsError.
        """
        os.fsync(self._descriptor)
        if self.part.exists():
            self._rename()
        sync_folder(self.path.parent)

    def _rename(self) -> None:
        if self.path.exists() and self.path.samefile(self.part):
            self.part.unlink()
            return
        try:
            os.link(self.part, self.path)
            self.part.unlink()
        except OSError as error:
            if error.errno not in _NO_HARD_LINKS:
                raise
            self.path.touch(exist_ok=False)
            self.part.replace(self.path)

    def close(self) -> None:
        if self._descriptor >= 0:
            os.close(self._descriptor)
            self._descriptor = -1
