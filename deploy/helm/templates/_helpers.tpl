{{- define "tesserae.name" -}}
{{ .Release.Name | trunc 40 | trimSuffix "-" }}
{{- end }}

{{/* Labels of everything: (dict "root" $ "part" PART) */}}
{{- define "tesserae.labels" -}}
helm.sh/chart: {{ .root.Chart.Name }}-{{ .root.Chart.Version }}
app.kubernetes.io/version: {{ .root.Values.image.tag | default .root.Chart.AppVersion | quote }}
app.kubernetes.io/managed-by: {{ .root.Release.Service }}
{{ include "tesserae.selector" . }}
{{- end }}

{{/* Labels that say which pods are meant: (dict "root" $ "part" PART), all without a part */}}
{{- define "tesserae.selector" -}}
app.kubernetes.io/name: tesserae
app.kubernetes.io/instance: {{ .root.Release.Name }}
{{- with .part }}
app.kubernetes.io/component: {{ . }}
{{- end }}
{{- end }}

{{/*
A pod: (dict "root" $ "part" PART "group" VALUES "work" on|off "device" DEVICE "drain" SECONDS).
The grace of the pod is longer than what the service takes to stop: delay, grace period, and ten seconds.
*/}}
{{- define "tesserae.pod" -}}
metadata:
  labels: {{- include "tesserae.labels" . | nindent 4 }}
  annotations:
    checksum/settings: {{ toJson .root.Values.settings | sha256sum }}
spec:
  serviceAccountName: {{ include "tesserae.name" .root }}
  automountServiceAccountToken: false
  terminationGracePeriodSeconds: {{ add .drain (int (index .root.Values.settings "TESSERAE_GRACE_PERIOD" | default 10)) 20 }}
  {{- with .root.Values.image.pullSecrets }}
  imagePullSecrets: {{- toYaml . | nindent 4 }}
  {{- end }}
  {{- with .group.runtimeClass }}
  runtimeClassName: {{ . }}
  {{- end }}
  securityContext:
    runAsNonRoot: true
    runAsUser: 10001
    runAsGroup: 10001
    fsGroup: 10001
    seccompProfile: {type: RuntimeDefault}
  topologySpreadConstraints:
    - maxSkew: 1
      topologyKey: kubernetes.io/hostname
      whenUnsatisfiable: ScheduleAnyway
      labelSelector:
        matchLabels: {{- include "tesserae.selector" . | nindent 10 }}
  containers:
    - name: tesserae
      image: "{{ .root.Values.image.repository }}:{{ .root.Values.image.tag | default .root.Chart.AppVersion }}"
      imagePullPolicy: {{ .root.Values.image.pullPolicy }}
      args: [serve]
      ports:
        - {name: http, containerPort: 8080}
      env:
        - name: TESSERAE_STORE
          valueFrom: {secretKeyRef: {name: {{ .root.Values.database.secret }}, key: url}}
        - {name: TESSERAE_BLOBS, value: {{ .root.Values.bucket.place | quote }}}
        - {name: TESSERAE_WORK, value: {{ .work | quote }}}
        - {name: TESSERAE_DEVICE, value: {{ .device }}}
        - {name: TESSERAE_DRAIN_DELAY, value: {{ .drain | quote }}}
        - {name: TESSERAE_TOKENS, value: /etc/tesserae/tokens.json}
        - {name: AWS_REGION, value: {{ .root.Values.bucket.region | quote }}}
        {{- with .root.Values.bucket.endpoint }}
        - {name: AWS_ENDPOINT_URL, value: {{ . | quote }}}
        {{- end }}
        {{- if .root.Values.bucket.allowHttp }}
        - {name: AWS_ALLOW_HTTP, value: "true"}
        {{- end }}
        {{- range $name, $value := .root.Values.settings }}
        - {name: {{ $name }}, value: {{ $value | quote }}}
        {{- end }}
      {{- with .root.Values.bucket.secret }}
      envFrom:
        - secretRef: {name: {{ . }}}
      {{- end }}
      # opening a GPU and trying it takes a while
      startupProbe:
        httpGet: {path: /healthz, port: http}
        periodSeconds: 2
        failureThreshold: 90
      livenessProbe:
        httpGet: {path: /healthz, port: http}
        periodSeconds: 10
        timeoutSeconds: 5
        failureThreshold: 6
      readinessProbe:
        httpGet: {path: /readyz, port: http}
        periodSeconds: 5
        timeoutSeconds: 5
      securityContext:
        allowPrivilegeEscalation: false
        readOnlyRootFilesystem: true
        capabilities: {drop: [ALL]}
      resources: {{- toYaml .group.resources | nindent 8 }}
      volumeMounts:
        - {name: data, mountPath: /data}
        - {name: tmp, mountPath: /tmp}
        - {name: tokens, mountPath: /etc/tesserae, readOnly: true}
  volumes:
    # answers that are made of large results; jobs and their files are elsewhere
    - {name: data, emptyDir: {}}
    - {name: tmp, emptyDir: {}}
    # for the user of the service, and for no other
    - {name: tokens, secret: {secretName: {{ .root.Values.tokens.secret }}, defaultMode: 0440}}
  {{- with .group.nodeSelector }}
  nodeSelector: {{- toYaml . | nindent 4 }}
  {{- end }}
  {{- with .group.tolerations }}
  tolerations: {{- toYaml . | nindent 4 }}
  {{- end }}
{{- end }}
