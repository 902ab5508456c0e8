"""Publication of a survey for other programs of the company by MQTT or OPC UA, from a separate
process: state, findings and results.

The folder of the survey is only read. The package needs the extra ``stepdiag[mqtt]`` or
``stepdiag[opcua]``; only functions of `cli` import it.
"""
