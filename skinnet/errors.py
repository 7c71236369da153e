"""Exception tree of errors that a user or a peer can cause.

    SkinnetError
    ├── DeploymentError     invalid deployment: names file, key, value, what is allowed
    ├── UsageError          options of a command that contradict each other, or have no valid value
    ├── FormatError         file of a newer format than this program reads
    ├── MemoryFileError     long-term memory file damaged, locked, or of another robot or version
    ├── RecordingError      not a recording, of a newer version, or damaged
    ├── RecorderError       a recording cannot be written
    ├── ModelError          an MJCF model does not compile or lacks a named element
    ├── ProtocolError       malformed message of a peer; counted and dropped, never fatal
    ├── PortInUseError      the endpoint to listen on is in use
    ├── RunFolderError      not a run folder, incomplete, or damaged
    ├── UnreachableError    no answer at the endpoint to connect to
    ├── NameTakenError      a process of this name is already in the loop
    ├── UpstreamLostError   a required upstream process is gone or silent
    └── ProcessFailedError  a process of the run ended with an error

A bug of this program is an AssertionError or an ordinary Python exception, never one of these.
"""

__all__ = [
    "DeploymentError",
    "FormatError",
    "MemoryFileError",
    "ModelError",
    "NameTakenError",
    "PortInUseError",
    "ProcessFailedError",
    "ProtocolError",
    "RecorderError",
    "RecordingError",
    "RunFolderError",
    "SkinnetError",
    "UnreachableError",
    "UpstreamLostError",
    "UsageError",
]


class SkinnetError(Exception):
    """Root of all errors that a user or a peer can cause; the text is one line."""


class DeploymentError(SkinnetError):
    """Invalid deployment or setting; the text names file, key, value, what is allowed, what to do."""


class UsageError(SkinnetError):
    """Options of a command that contradict each other or have no valid value; the text names them."""


class FormatError(SkinnetError):
    """File of a newer format, or of none; the text says which formats this program reads."""


class MemoryFileError(SkinnetError):
    """Invalid memory file, or invalid content for one; the text says which and why."""


class ModelError(SkinnetError):
    """MJCF model that does not compile, or lacks an element that the deployment names."""


class RecordingError(SkinnetError):
    """Unreadable recording file; the text says why."""


class RecorderError(SkinnetError):
    """Recording that cannot be written; the text names the file and says why."""


class ProtocolError(SkinnetError):
    """Malformed message: it does not decode, has another schema version, or names an unknown entity."""


class PortInUseError(SkinnetError):
    """Endpoint to listen on that is already in use."""


class RunFolderError(SkinnetError):
    """Folder that is no run folder, is incomplete, or has a damaged file."""


class UnreachableError(SkinnetError):
    """Endpoint to connect to that does not answer, or not as expected."""


class NameTakenError(SkinnetError):
    """Process name that another process in the loop already holds."""


class UpstreamLostError(SkinnetError):
    """Required upstream process that is gone or silent.

    Attributes:
        process: Name of the upstream process.
        silent: True if it is there, but sent no period end in time; False if it is gone.
    """

    def __init__(self, text: str, process: str = "", *, silent: bool = False) -> None:
        super().__init__(text)
        self.process, self.silent = process, silent


class ProcessFailedError(SkinnetError):
    """Process of the run that ended with an error; the text names it and quotes its last lines."""
