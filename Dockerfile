# keystore-audit with both engines: Java and the Alloy Analyzer are inside, so that it runs without a network.
#   docker build -t keystore-audit .
#   docker run --rm --network none --user "$(id -u):$(id -g)" -v "$PWD/keys:/keys:ro" keystore-audit /keys
ARG BASE=debian:bookworm-slim

FROM ${BASE} AS build
RUN apt-get update \
 && apt-get install -y --no-install-recommends ca-certificates python3 python3-venv \
 && rm -rf /var/lib/apt/lists/*
WORKDIR /source
RUN python3 -m venv /opt/keystore-audit
COPY requirements/audit.txt requirements/
RUN /opt/keystore-audit/bin/pip install --no-cache-dir --require-hashes --requirement requirements/audit.txt
COPY pyproject.toml README.md LICENSE ./
COPY keystore_audit keystore_audit
COPY schemas schemas
COPY alloy alloy
RUN /opt/keystore-audit/bin/pip install --no-cache-dir --no-deps --no-build-isolation . \
 && XDG_CACHE_HOME=/tmp/cache /opt/keystore-audit/bin/keystore-audit engine install \
 && mv /tmp/cache/keystore-audit/*.jar /opt/keystore-audit/alloy.jar \
 && chmod 0644 /opt/keystore-audit/alloy.jar

FROM ${BASE}
RUN apt-get update \
 && apt-get install -y --no-install-recommends python3 \
 && rm -rf /var/lib/apt/lists/*
COPY --from=build /opt/keystore-audit /opt/keystore-audit
ENV PATH=/opt/keystore-audit/bin:/usr/bin:/bin \
    KEYSTORE_AUDIT_ALLOY_JAR=/opt/keystore-audit/alloy.jar \
    PYTHONDONTWRITEBYTECODE=1
# Nobody in particular: --user says whose files are read.
USER 65532:65532
WORKDIR /tmp
ENTRYPOINT ["keystore-audit"]
CMD ["--help"]
