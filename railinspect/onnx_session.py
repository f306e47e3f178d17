"""An ONNX file from anywhere as a session of ONNX Runtime, or one sentence why not."""

from __future__ import annotations

import onnxruntime

from railinspect.errors import BundleError


def open_session(data: bytes, name: str, threads: int) -> onnxruntime.InferenceSession:
    """A session on the CPU.

    Args:
        data: The ONNX file.
        name: How the error message calls it.
        threads: Processor threads of one run.

    Raises:
        BundleError: if the bytes are no ONNX file that can be run.
    """
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = threads
    options.inter_op_num_threads = 1
    # Threads that wait by spinning halve the speed as soon as anything else needs the cores.
    options.add_session_config_entry("session.intra_op.allow_spinning", "0")
    options.log_severity_level = 4  # what is wrong is said once, by the error below
    try:
        return onnxruntime.InferenceSession(data, options, providers=["CPUExecutionProvider"])
    except Exception as error:  # ONNX Runtime's own errors share no narrower base class
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise BundleError(f"{name} is not an ONNX file that can be run ({reason[:160]})") from error
