// Reads the results of a server with node-opcua: `node results.mjs URL`. Prints the latest by variable and by method as JSON.
import opcua from "node-opcua-client";

const { AttributeIds, OPCUAClient } = opcua;

const client = OPCUAClient.create({ endpointMustExist: false, connectionStrategy: { maxRetry: 1 } });
await client.connect(process.argv[2]);
const session = await client.createSession();
try {
  const namespaces = await session.readNamespaceArray();
  const own = namespaces.indexOf("urn:stepdiag:publish");
  const below = async (node, matches) => (await session.browse(node)).references.filter(({ browseName }) => matches(browseName));
  const [machine] = await below("ns=0;i=85", (name) => name.namespaceIndex === own);
  const [management] = await below(machine.nodeId, (name) => name.name === "ResultManagement");
  const [folder] = await below(management.nodeId, (name) => name.name === "Results");
  const [method] = await below(management.nodeId, (name) => name.name === "GetLatestResult");
  const variable = (await below(folder.nodeId, () => true)).at(-1);
  const read = await session.read({ nodeId: variable.nodeId, attributeId: AttributeIds.Value });
  const called = await session.call({
    objectId: management.nodeId,
    methodId: method.nodeId,
    inputArguments: [{ dataType: "Int32", value: 0 }],
  });
  const [notification] = await below(machine.nodeId, (name) => name.name === "Notification");
  const [list] = await below(notification.nodeId, (name) => name.name === "Prognoses");
  const prognoses = {};
  for (const { nodeId, browseName } of await below(list.nodeId, () => true)) {
    const [time] = await below(nodeId, (name) => name.name === "PredictedTime");
    prognoses[browseName.name] = (await session.read({ nodeId: time.nodeId, attributeId: AttributeIds.Value })).value.value;
  }
  const plain = ({ resultMetaData, resultContent }) => ({
    type: resultMetaData.constructor.name,
    id: resultMetaData.resultId,
    part: resultMetaData.partId,
    job: resultMetaData.jobId,
    ended: resultMetaData.processingTimes.endTime,
    content: resultContent.map(({ value }) => JSON.parse(value).schema),
  });
  console.log(JSON.stringify({
    variable: plain(read.value.value),
    method: plain(called.outputArguments[1].value),
    prognoses,
  }));
} finally {
  await session.close();
  await client.disconnect();
}
