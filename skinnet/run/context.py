"""Context of one run: all that its launchers share, frozen."""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from skinnet.deployment import Deployment
from skinnet.output_folder import OwnedFolder
from skinnet.protocol.channels import Keys
from skinnet.run.observers.observer_endpoint import ObserverEndpoint
from skinnet.run.process_list import ProcessSpec, process_list
from skinnet.run.progress import ProgressDisplay
from skinnet.transport.loop_transport import LoopTransport

__all__ = ["RunContext"]


@dataclass(frozen=True)
class RunContext:
    """Context of a run.

    Attributes:
        deployment: Deployment to run.
        base: Base folder of its relative paths.
        folder: Run folder, which this process owns; it has `deployment.json`.
        progress: Progress display.
        observers: Observer endpoint; None if the run cannot be observed.
        record: True if a recorder takes part.
    """

    deployment: Deployment
    base: Path
    folder: OwnedFolder
    progress: ProgressDisplay
    observers: ObserverEndpoint | None = None
    record: bool = False

    @property
    def out(self) -> Path:
        """Path of the run folder."""
        return self.folder.path

    @cached_property
    def keys(self) -> Keys:
        """Keys of the robot."""
        return Keys(self.deployment.robot)

    @cached_property
    def processes(self) -> tuple[ProcessSpec, ...]:
        """Processes of the run; the body, the hub, comes first."""
        return process_list(self.deployment, self.record)

    def attach(self, transport: LoopTransport) -> None:
        """Connect progress display and observers to the loop at `transport`."""
        transport.enable_recording(1)  # messages of external clients
        self.progress.subscribe(transport.session, self.keys)
        if self.observers is not None:
            self.observers.attach(transport)

    def detach(self) -> None:
        """Disconnect the observers from the loop."""
        if self.observers is not None:
            self.observers.detach()
