"""The exception tree.

    SkinnetError
    ├── DeploymentError     what a user wrote does not hold: file, key, value, what is allowed
    ├── MemoryFileError     a file of long-term memory is damaged, in use, of another robot or version
    ├── RecordingError      a file is no recording, or of a newer version, or damaged
    ├── RecorderError       a recording cannot be written
    ├── ModelError          an MJCF model does not compile or lacks something that was named
    ├── ProtocolError       a peer sent what cannot be understood; counted and dropped, never fatal
    ├── PortInUseError      the endpoint to listen on is taken
    ├── RunFolderError      a folder is not what a run left behind, or what is in it is damaged
    ├── UnreachableError    nobody answers at the endpoint to connect to
    ├── NameTakenError      a process of this name is in the loop already
    ├── UpstreamLostError   a process that this one needs is gone
    └── ProcessFailedError  a process of the run ended with an error

A bug of ours is an AssertionError or an ordinary Python exception, never one of these.
"""

__all__ = [
    "DeploymentError",
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
]


class SkinnetError(Exception):
    """Root of all errors that a user or a peer can cause; its text is one clear line."""


class DeploymentError(SkinnetError):
    """A deployment does not hold; the text names file, key, value, what is allowed, what to do."""


class MemoryFileError(SkinnetError):
    """What a memory file holds, or what should be kept in one, does not hold; the text says which and why."""


class ModelError(SkinnetError):
    """An MJCF model does not compile, or does not have what a deployment names."""


class RecordingError(SkinnetError):
    """A file is no recording that this program can read; the text says why."""


class RecorderError(SkinnetError):
    """What is said cannot be written down; the text names the file and says why."""


class ProtocolError(SkinnetError):
    """A message that does not decode, has another schema version, or names what does not exist."""


class PortInUseError(SkinnetError):
    """The endpoint to listen on is already taken."""


class RunFolderError(SkinnetError):
    """A folder that no run left behind, or left unfinished, or a file in it that is damaged."""


class UnreachableError(SkinnetError):
    """Nobody answers at the endpoint to connect to, or not as was asked."""


class NameTakenError(SkinnetError):
    """A process of this name is in the loop already: two would answer for one."""


class UpstreamLostError(SkinnetError):
    """A process whose frames this one cannot do without is gone or silent."""


class ProcessFailedError(SkinnetError):
    """A process of the run ended with an error; the text names it and carries its last lines."""
