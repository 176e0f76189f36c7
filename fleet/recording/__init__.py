"""Recording: the stream a viewer shows, and the files a run leaves behind."""

from fleet.recording.errors import OutputError as OutputError
from fleet.recording.errors import RecordingError as RecordingError
from fleet.recording.frame import Frame as Frame
from fleet.recording.frame import LogLine as LogLine
from fleet.recording.frame import NullRecorder as NullRecorder
from fleet.recording.frame import Recorder as Recorder
from fleet.recording.frame import Wait as Wait
from fleet.recording.header import DrawnFloor as DrawnFloor
from fleet.recording.header import Header as Header
from fleet.recording.rerun_recorder import RerunRecorder as RerunRecorder
from fleet.recording.rerun_recorder import require_free_port as require_free_port
from fleet.recording.rerun_recorder import require_rerun as require_rerun
from fleet.recording.rerun_stream.pictures import PictureRecorder as PictureRecorder
from fleet.recording.run_file import DECISIONS as DECISIONS
from fleet.recording.run_file import RECORDING as RECORDING
from fleet.recording.run_file import RunFile as RunFile
from fleet.recording.run_file import RunRecord as RunRecord
from fleet.recording.run_file import commit as commit
from fleet.recording.run_file import discard_output as discard_output
from fleet.recording.run_file import prepare_output as prepare_output
from fleet.recording.run_file import read_run as read_run
from fleet.recording.run_file import versions as versions
