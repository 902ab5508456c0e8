"""Publication of a survey for the company's other programs: its state, findings and results, by
MQTT or OPC UA, from a separate process.

In: the folder of a survey, read and never changed. Out: messages to a broker, or a server for
clients. The package needs the extra ``stepdiag[mqtt]`` or ``stepdiag[opcua]``; only functions of
`cli` import it.
"""
