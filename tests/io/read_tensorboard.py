"""read_tensorboard.py FOLDER: what TensorBoard's own code reads in the event file of a run's folder, as JSON.

    scalars  {tag: [[step, wall time, value], ...]}
    texts    {tag: [[step, wall time, text], ...]}
    columns  what the HPARAMS tab shows: {hparams: {name: type}, metrics: [tag, ...]}
    sessions its rows: [{run, status, start, end, hparams: {name: value}, metrics: {tag: [step, value]}}, ...]

Exit code 77 where TensorBoard is not installed (`scripts/bootstrap --dev` installs it).
"""

import json
import sys

try:
    from tensorboard import context
    from tensorboard.backend.event_processing import data_provider, plugin_event_multiplexer
    from tensorboard.backend.event_processing.event_accumulator import EventAccumulator
    from tensorboard.plugins import base_plugin
    from tensorboard.plugins.hparams import api_pb2, backend_context, get_experiment, list_session_groups
    from tensorboard.util import tensor_util
except ImportError as error:
    print(error, file=sys.stderr)
    sys.exit(77)


def read_values(folder):
    """Curves and texts, each point of them."""
    events = EventAccumulator(folder, size_guidance={"scalars": 0, "tensors": 0})
    events.Reload()
    tags = events.Tags()
    texts = [tag for tag in tags["tensors"] if events.SummaryMetadata(tag).plugin_data.plugin_name == "text"]

    def text_of(event):
        (text,) = tensor_util.make_ndarray(event.tensor_proto)  # a list of one
        return text.decode()

    return {
        "scalars": {tag: [[e.step, e.wall_time, e.value] for e in events.Scalars(tag)] for tag in tags["scalars"]},
        "texts": {tag: [[e.step, e.wall_time, text_of(e)] for e in events.Tensors(tag)] for tag in texts},
    }


def value_of(value):
    """Of a google.protobuf.Value."""
    return getattr(value, value.WhichOneof("kind"))


def read_hparams_tab(folder):
    """The answers of the HPARAMS plugin to the two questions that its page asks."""
    multiplexer = plugin_event_multiplexer.EventMultiplexer()
    multiplexer.AddRunsFromDirectory(folder)
    multiplexer.Reload()
    provider = data_provider.MultiplexerDataProvider(multiplexer, folder)
    backend = backend_context.Context(base_plugin.TBContext(data_provider=provider))

    def answer(handler, request):
        return handler(context.RequestContext(), backend, "", request).run()

    experiment = answer(get_experiment.Handler, api_pb2.GetExperimentRequest())
    all_groups = api_pb2.ListSessionGroupsRequest(
        slice_size=100, allowed_statuses=[value for _, value in api_pb2.Status.items()]
    )
    groups = answer(list_session_groups.Handler, all_groups).session_groups
    return {
        "columns": {
            "hparams": {info.name: api_pb2.DataType.Name(info.type) for info in experiment.hparam_infos},
            "metrics": [info.name.tag for info in experiment.metric_infos],
        },
        "sessions": [
            {
                "run": session.name,
                "status": api_pb2.Status.Name(session.status),
                "start": session.start_time_secs,
                "end": session.end_time_secs,
                "hparams": {name: value_of(value) for name, value in sorted(group.hparams.items())},
                "metrics": {m.name.tag: [m.training_step, m.value] for m in session.metric_values},
            }
            for group in groups
            for session in group.sessions
        ],
    }


if __name__ == "__main__":
    json.dump({**read_values(sys.argv[1]), **read_hparams_tab(sys.argv[1])}, sys.stdout, indent=1)
